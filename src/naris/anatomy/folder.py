"""A whole anatomy on disk, and `load_anatomy`, which takes a folder, a surface file or the word `builtin`.

The folder holds `anatomy.json` (schema `naris.anatomy/1`: name, frame, source, air space, landmarks, region sets and
passages) and the surface as PLY, whose name carries the start of its SHA-256. `anatomy.json` is written last and names
the surface, so a folder is whole at any moment, also while it is being replaced. Nothing in it is executed.
"""

from __future__ import annotations

import hashlib
import json
import logging
from pathlib import Path
from typing import Any

import numpy as np

import naris
from naris.anatomy import mean_nose
from naris.anatomy.passages import find_passages
from naris.anatomy.ply import ply_bytes, read_ply
from naris.anatomy.read import READERS, read_surface
from naris.anatomy.regions import even_slabs, read_regions, regions_from_json, regions_to_json, whole
from naris.core.anatomy import Airspace, Anatomy, Between, Enclosed, Entrance, Passage, RegionSet
from naris.core.atomic import write_bytes, write_json
from naris.ct.scan import SCAN_FILES
from naris.errors import ConfigurationChanged, RegionError, SurfaceError

log = logging.getLogger(__name__)

SCHEMA = "naris.anatomy/1"
DESCRIPTION = "anatomy.json"
BUILTIN = "builtin"
SLABS = "slabs"
_SURFACE = "surface-"


def check_folder(folder: Path) -> None:
    """See that an anatomy may be saved there, before work is spent on it.

    Raises:
        SurfaceError: if the path is a file, or a folder with other things and no anatomy.
    """
    if folder.exists() and not folder.is_dir():
        raise SurfaceError(f"a folder to save to at {folder}", "a file", "give another path")
    _check_own(folder)


def save_anatomy(anatomy: Anatomy, folder: Path | str) -> None:
    """Writes an anatomy to a folder, made if need be; an anatomy that is there is replaced.

    Raises:
        SurfaceError: if the path is a file, or a folder with other things and no anatomy; nothing is touched.
        DiskFull: if there is no room; an anatomy that was there is still there.
    """
    folder = Path(folder)
    check_folder(folder)
    content = ply_bytes(anatomy)
    digest = hashlib.sha256(content).hexdigest()
    surface = folder / f"{_SURFACE}{digest[:8]}.ply"
    previous = _surface_of(folder)
    write_bytes(surface, content)
    write_json(folder / DESCRIPTION, _describe(anatomy, surface.name, digest))
    if previous is not None and previous != surface:
        previous.unlink(missing_ok=True)


def remove_anatomy(folder: Path) -> None:
    """Takes away the anatomy that a folder holds, and the folder if nothing else is in it.

    Raises:
        SurfaceError: if its description cannot be read.
    """
    if not (folder / DESCRIPTION).is_file():
        return
    surface = _surface_of(folder)
    (folder / DESCRIPTION).unlink()
    if surface is not None:
        surface.unlink(missing_ok=True)
    if not any(folder.iterdir()):
        folder.rmdir()


def files_in(folder: Path) -> list[Path]:
    """The files of the anatomy that a folder holds.

    Raises:
        SurfaceError: if it holds none, or its description cannot be read.
    """
    _read_description(folder)
    surface = _surface_of(folder)
    return [folder / DESCRIPTION, *([surface] if surface is not None else [])]


def others_in(folder: Path) -> list[str]:
    """What a folder holds beside anatomies; hidden files, and what a save that was stopped left, do not count."""
    return sorted(
        one.name
        for one in folder.iterdir()
        if not one.name.startswith(".") and one.name != DESCRIPTION and not one.match(_SURFACE + "*.ply")
    )


def digest_in(folder: Path) -> str | None:
    """The digest that the anatomy in a folder was saved with; None where it holds none.

    Raises:
        SurfaceError: if its description cannot be read.
    """
    return str(_read_description(folder).get("digest", "")) if (folder / DESCRIPTION).is_file() else None


def source_in(folder: Path) -> str | None:
    """Where the anatomy that a folder holds came from; None where it holds none.

    Raises:
        SurfaceError: if its description cannot be read.
    """
    return str(_read_description(folder).get("source", "")) if (folder / DESCRIPTION).is_file() else None


def check_replaces(source: str, folder: Path) -> None:
    """See that what a folder holds is of the same source: the anatomy of another is not to be lost.

    Raises:
        ConfigurationChanged: if not.
    """
    earlier = source_in(folder)
    if earlier is not None and earlier != source:
        expected = f"no anatomy in {folder}, or one from {source}"
        raise ConfigurationChanged(expected, f"one from {earlier or 'elsewhere'}", "give another folder")


def region_sets_in(folder: Path) -> tuple[str, ...]:
    """The names of the region sets of the anatomy that a folder holds; none where it holds no anatomy.

    Raises:
        SurfaceError: if its description cannot be read.
    """
    if not (folder / DESCRIPTION).is_file():
        return ()
    return tuple(str(one.get("name")) for one in _read_description(folder).get("regions", ()) if isinstance(one, dict))


def load_anatomy(
    what: Path | str,
    *,
    regions: RegionSet | Path | str | None = None,
    frame: str | None = None,
    unit: str = "mm",
    airspace: Airspace | None = None,
    passages: bool = True,
) -> Anatomy:
    """An anatomy, from wherever it is.

    Args:
        what: `builtin` (the built-in nose), a folder of `save_anatomy`, or a surface file (see `read_surface`).
        regions: a region set to add in front of those that are known: itself, a JSON file of it (`read_regions`), or
            `slabs` for four even slabs from front to back. A surface about which nothing is known gets `whole`.
        frame, unit, airspace: of a surface file, as in `read_surface`.
        passages: find passages where there are none (takes a few seconds).

    Raises:
        SurfaceError: if there is no anatomy, or one that cannot be used.
        RegionError: if the region set cannot be read or is in another frame.
        PoseError: if the lumen is too thin to find passages.
    """
    if str(what) == BUILTIN:
        from naris.anatomy.builtin import built_in_nose

        anatomy = built_in_nose()
    elif Path(what).is_dir() or Path(what).name == DESCRIPTION:
        anatomy = _load_folder(Path(what) if Path(what).is_dir() else Path(what).parent)
    elif Path(what).suffix.lower() in READERS:
        anatomy = read_surface(what, frame=frame, unit=unit, airspace=airspace)
    else:
        raise SurfaceError(
            f"the word {BUILTIN}, a folder with {DESCRIPTION}, or a surface file ({', '.join(READERS)})",
            repr(str(what)),
            "make one with naris anatomy from-ct" if str(what).lower().endswith(SCAN_FILES) else "check the path",
        )
    anatomy = _with_regions(anatomy, regions)
    if passages and not anatomy.passages:
        routes = mean_nose.ROUTES if anatomy.frame == mean_nose.FRAME and _is_air_of_mean_nose(anatomy) else None
        anatomy = anatomy.with_(passages=find_passages(anatomy, routes=routes))
    return anatomy


def _is_air_of_mean_nose(anatomy: Anatomy) -> bool:
    return anatomy.airspace == mean_nose.AIRSPACE and mean_nose.is_mean_nose(anatomy.vertices_mm, anatomy.faces)


def _with_regions(anatomy: Anatomy, regions: RegionSet | Path | str | None) -> Anatomy:
    if regions is None:
        if anatomy.regions:
            return anatomy
        log.info("nothing is known of regions of %s: it is one region, `whole`", anatomy.name)
        regions = whole(anatomy.frame)
    elif isinstance(regions, str) and regions == SLABS:
        regions = even_slabs(anatomy)
    elif isinstance(regions, (str, Path)):
        regions = read_regions(regions)
    if regions.frame != anatomy.frame:
        raise RegionError(
            f"regions in the frame {anatomy.frame!r} of {anatomy.name}",
            f"regions in {regions.frame!r}",
            "give the regions in that frame",
        )
    others = {name: one for name, one in anatomy.regions.items() if name != regions.name}
    return anatomy.with_(regions={regions.name: regions, **others})


def _describe(anatomy: Anatomy, surface: str, digest: str) -> dict[str, Any]:
    air: dict[str, Any] = {"kind": anatomy.airspace.kind}
    if isinstance(anatomy.airspace, Between):
        entrance = anatomy.airspace.entrance
        air |= {"ball_mm": anatomy.airspace.ball_mm, "entrance": None if entrance is None else vars(entrance)}
    return {
        "schema": SCHEMA,
        "naris": naris.__version__,
        "name": anatomy.name,
        "frame": anatomy.frame,
        "unit": "mm",
        "source": anatomy.source,
        "digest": anatomy.digest,
        "surface": {"file": surface, "sha256": digest},
        "airspace": air,
        "landmarks_mm": {name: np.asarray(point).tolist() for name, point in anatomy.landmarks_mm.items()},
        "regions": [regions_to_json(one) for one in anatomy.regions.values()],
        "passages": [
            {"name": one.name, "points_mm": one.points_mm.tolist(), "clearance_mm": one.clearance_mm.tolist()}
            for one in anatomy.passages
        ],
    }


def _load_folder(folder: Path) -> Anatomy:
    value = _read_description(folder)
    try:
        surface, digest = folder / str(value["surface"]["file"]), str(value["surface"]["sha256"])
        if surface.parent != folder:
            raise ValueError("surface")
        regions = [regions_from_json(one) for one in value["regions"]]
        details: dict[str, Any] = {
            "frame": str(value["frame"]),
            "name": str(value["name"]),
            "source": str(value["source"]),
            "regions": {one.name: one for one in regions},
            "passages": tuple(_passage(one) for one in value["passages"]),
            "landmarks_mm": {str(name): _point(point) for name, point in value["landmarks_mm"].items()},
            "airspace": _airspace(value["airspace"]),
        }
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise SurfaceError(
            f"a whole {DESCRIPTION} in {folder}", f"one with a wrong or missing {error}", "save the anatomy again"
        ) from error
    if not surface.is_file():
        raise SurfaceError(f"the surface {surface.name} in {folder}", "nothing there", "save the anatomy again")
    content = surface.read_bytes()
    if hashlib.sha256(content).hexdigest() != digest:
        raise SurfaceError(f"{surface.name} as it was saved in {folder}", "other content", "save the anatomy again")
    mesh = read_ply(surface, content)
    return Anatomy(mesh.vertices, mesh.faces.astype(np.int32), **details)


def _read_description(folder: Path) -> dict[str, Any]:
    path = folder / DESCRIPTION
    try:
        value = json.loads(path.read_text("utf-8"))
    except OSError as error:
        got = "none" if isinstance(error, FileNotFoundError) else error.strerror or "an error"
        raise SurfaceError(f"an anatomy ({DESCRIPTION}) in the folder {folder}", got, "check the path") from error
    except ValueError as error:
        raise SurfaceError(f"JSON in {path}", "something else", "save the anatomy again") from error
    if not isinstance(value, dict) or value.get("schema") != SCHEMA:
        got = repr(value.get("schema")) if isinstance(value, dict) else "none"
        raise SurfaceError(f"the schema {SCHEMA} in {path}", got, "use the version of naris that wrote it")
    return value


def _check_own(folder: Path) -> None:
    """See that the folder is nobody else's."""
    if not folder.is_dir() or (folder / DESCRIPTION).is_file():
        return
    others = others_in(folder)
    if others:
        raise SurfaceError(
            f"a new or empty folder, or one with an {DESCRIPTION}, at {folder}",
            f"one with {others[0]}" + (f" and {len(others) - 1} more" if others[1:] else ""),
            "give another folder",
        )


def _surface_of(folder: Path) -> Path | None:
    """The surface file of the anatomy that the folder holds, if it holds one."""
    if not (folder / DESCRIPTION).is_file():
        return None
    name = _read_description(folder).get("surface", {}).get("file", "")
    return folder / name if Path(name).name == name and name else None


def _passage(value: dict[str, Any]) -> Passage:
    points, clearance = (
        np.array(value["points_mm"], dtype=np.float64),
        np.array(value["clearance_mm"], dtype=np.float64),
    )
    if points.ndim != 2 or points.shape[1] != 3 or clearance.shape != points.shape[:1]:
        raise ValueError("passages")
    return Passage(str(value["name"]), points, clearance)


def _point(value: list[float]) -> np.ndarray:
    point = np.array(value, dtype=np.float64)
    if point.shape != (3,):
        raise ValueError("landmarks_mm")
    return point


def _airspace(value: dict[str, Any]) -> Airspace:
    if value["kind"] == "enclosed":
        return Enclosed()
    if value["kind"] != "between":
        raise ValueError("airspace")
    box = value["entrance"]
    if box is None:
        return Between(float(value["ball_mm"]))
    low, high = (tuple(_point(box[name]).tolist()) for name in ("low_mm", "high_mm"))
    entrance = Entrance(low, high, float(box["ball_mm"]), float(box["room_mm"]))
    return Between(float(value["ball_mm"]), entrance)
