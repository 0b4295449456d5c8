"""Surfaces from files: PLY, STL, OBJ and VTP, checked before anything is made of them."""

from __future__ import annotations

import hashlib
import logging
from collections.abc import Callable
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from naris.anatomy import mean_nose
from naris.anatomy.checks import (
    UNITS_MM,
    SurfaceReport,
    check_surface,
    faces_of_piece,
    piece_volumes_ml,
    pieces_of,
    wound_one_way,
)
from naris.anatomy.mesh_files import MeshFile, broken, read_obj, read_stl, read_vtp
from naris.anatomy.ply import read_ply
from naris.anatomy.regions import PAPER_SLABS
from naris.core.anatomy import Airspace, Anatomy, Between, Enclosed
from naris.errors import SurfaceError

log = logging.getLogger(__name__)

READERS: dict[str, Callable[[Path, bytes], MeshFile]] = {
    ".ply": read_ply, ".stl": read_stl, ".obj": read_obj, ".vtp": read_vtp
}  # fmt: skip
_DEBRIS = 0.02
_LARGEST_BYTES = 2**31
_TURN_TO_LPS = np.array([-1.0, -1.0, 1.0])


def read_surface(
    path: Path | str, *, frame: str | None = None, unit: str = "mm", airspace: Airspace | None = None
) -> Anatomy:
    """The closed surface in a file, in mm, wound so that it encloses a positive volume.

    Mended with a notice (through `logging`): a surface inside out or wound unevenly, corners that lie on each other but
    are not joined, pieces below 2 % of the volume of the largest (dropped). The mean nose of Sinha et al. 2018 is
    recognised in any format: it gets its frame, its region set `paper` and its air space.

    Args:
        path: a .ply, .stl, .obj or .vtp file.
        frame: the frame of the coordinates in the file: `LPS`, `RAS` (turned to LPS), in capitals or not, or a name of
            its own. By default what the file says of itself (`SPACE=…`, as 3D Slicer writes it), and LPS if it says
            nothing.
        unit: of the numbers in the file: mm, cm, m, in or um.
        airspace: where the air is; by default enclosed by the surface. Between walls, several pieces may stand.

    Raises:
        SurfaceError: if the file is not a mesh, its frame is one of a patient's other than LPS and RAS (such as LAS),
            or the surface is open, in several large pieces, or has an extent that no nose has in this unit.
    """
    path = Path(path)
    if unit not in UNITS_MM:
        raise SurfaceError(f"a unit among {', '.join(UNITS_MM)}", repr(unit), "name one of those")
    content = _content(path)
    mesh = _parse(path, content)
    if not np.isfinite(mesh.vertices).all():
        raise SurfaceError(f"finite coordinates in {path.name}", "NaN or infinity", "repair the surface")
    vertices, faces = _tidy(path, mesh.vertices * UNITS_MM[unit], mesh.faces)
    vertices, faces = _mended(path, vertices, faces, unit, several=isinstance(airspace, Between))
    space = _frame(path, frame or mesh.space or "LPS")
    if space == "RAS":
        vertices, space = vertices * _TURN_TO_LPS, "LPS"
    source = f"{path.name} (SHA-256 {hashlib.sha256(content).hexdigest()})"
    anatomy = Anatomy(vertices, faces.astype(np.int32), space, path.stem, source, airspace=airspace or Enclosed())
    if frame in (None, mean_nose.FRAME) and mean_nose.is_mean_nose(vertices, faces):
        log.info("%s is the mean nose of Sinha et al. 2018: its frame and regions are known", path.name)
        anatomy = anatomy.with_(
            frame=mean_nose.FRAME,
            name=mean_nose.NAME,
            regions={PAPER_SLABS.name: PAPER_SLABS},
            airspace=airspace or mean_nose.AIRSPACE,
        )
    return anatomy


def _frame(path: Path, name: str) -> str:
    """The frame of that name; three letters that say where a patient's axes point are one in capitals or not."""
    code = name.upper()
    if len(code) != 3 or any(len(set(code) & set(ends)) != 1 for ends in ("LR", "AP", "IS")):
        return name
    if code not in ("LPS", "RAS"):
        raise SurfaceError(
            f"coordinates of {path.name} in LPS, RAS or a frame with a name of its own",
            f"{code}, which says where the patient's axes point",
            "export it in LPS or RAS, or name the right frame with --frame",
        )
    return code


def _content(path: Path) -> bytes:
    kinds = ", ".join(READERS)
    if path.suffix.lower() not in READERS and not path.is_dir():
        raise SurfaceError(f"a surface file ({kinds})", path.name, "convert it to one of these")
    if not path.is_file():
        got = "a folder" if path.is_dir() else "nothing there"
        raise SurfaceError(f"a surface file ({kinds}) at {path}", got, "check the path")
    if path.stat().st_size > _LARGEST_BYTES:
        raise SurfaceError(f"a surface file below {_LARGEST_BYTES / 2**30:.0f} GiB", path.name, "decimate the surface")
    try:
        content = path.read_bytes()
    except OSError as error:
        raise SurfaceError(f"a readable file {path}", error.strerror or "an error", "check its permissions") from error
    if not content:
        raise SurfaceError(f"a surface in {path.name}", "an empty file", "export the surface again")
    return content


def _parse(path: Path, content: bytes) -> MeshFile:
    mesh = READERS[path.suffix.lower()](path, content)
    if not len(mesh.vertices) or not len(mesh.faces):
        raise broken(path, path.suffix[1:].upper(), "no triangles")
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise broken(
            path,
            path.suffix[1:].upper(),
            f"vertex numbers {mesh.faces.min()}…{mesh.faces.max()} of {len(mesh.vertices)}",
        )
    return mesh


def _tidy(
    path: Path, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"]]:
    """Without unused vertices and faces of one edge; vertices at one place joined where that closes the surface."""
    faces = _proper(faces)
    if not len(faces):
        raise broken(path, path.suffix[1:].upper(), "no triangle with three different corners")
    if not check_surface(vertices, faces).closed:
        joined, index = np.unique(vertices, axis=0, return_inverse=True)
        again = _proper(index.reshape(-1)[faces])
        if len(joined) < len(vertices) and len(again):
            before, after = check_surface(vertices, faces), check_surface(joined, again)
            if after.open_edges < before.open_edges:
                log.warning("%s: corners at the same place were joined", path.name)
                vertices, faces = joined, again
    used = np.unique(faces)
    if len(used) == len(vertices):
        return vertices, faces
    return vertices[used], np.searchsorted(used, faces)


def _proper(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "g 3"]:
    return faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]


def _mended(
    path: Path, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], unit: str, several: bool
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"]]:
    report = check_surface(vertices, faces)
    _refuse_wrong_unit(path, report, unit)
    if not report.closed and not report.one_way:
        faces = wound_one_way(faces)
        report = check_surface(vertices, faces)
        if report.closed:
            log.warning("%s: its faces were wound unevenly; they were made to agree", path.name)
    if not report.closed:
        raise SurfaceError(
            f"a closed surface in {path.name}",
            f"{report.open_edges:,} open edges",
            "close its holes, e.g. with 3D Slicer or MeshLab",
        )
    if report.pieces > 1 and not several:
        vertices, faces = _largest_piece(path, vertices, faces, report)
        report = check_surface(vertices, faces)
    if report.volume_ml == 0:
        raise SurfaceError(f"a surface with an inside in {path.name}", "no volume", "export the surface again")
    if report.inside_out:
        log.warning("%s: the surface was inside out; its faces were turned", path.name)
        faces = faces[:, ::-1]
    return vertices, faces


def _refuse_wrong_unit(path: Path, report: SurfaceReport, unit: str) -> None:
    if report.unit == "mm":
        return
    names = {"m": "metres", "cm": "centimetres", "in": "inches", "um": "micrometres"}
    likely = [] if report.unit == "unknown" else report.unit.split(" or ")
    looks = f", as if it were in {' or '.join(names[one] for one in likely)}" if likely else ""
    raise SurfaceError(
        f"a surface 15 to 600 mm long in {path.name}",
        f"{report.longest_mm:.3g} mm{looks}",
        f"bring it to mm first: naris anatomy {path.name} --unit {' or '.join(likely)} -o DIR"
        if likely and unit == "mm"
        else "check the unit and the file",
    )


def _largest_piece(
    path: Path, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], report: SurfaceReport
) -> tuple[Float[np.ndarray, "w 3"], Int[np.ndarray, "g 3"]]:
    first, second = np.abs(report.piece_volumes_ml[:2])
    if second > _DEBRIS * first:
        raise SurfaceError(
            f"one connected surface in {path.name}",
            f"{report.pieces} pieces, the largest of {first:.3g} and {second:.3g} ml",
            "keep one of them or join them",
        )
    piece = pieces_of(len(vertices), faces)
    largest = int(np.argmax(np.abs(piece_volumes_ml(vertices, faces, piece))))
    kept = faces[faces_of_piece(faces, piece, largest)]
    log.warning("%s: %d small pieces were dropped", path.name, report.pieces - 1)
    used = np.unique(kept)
    return vertices[used], np.searchsorted(used, kept)
