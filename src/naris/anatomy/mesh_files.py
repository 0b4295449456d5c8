"""What a mesh file holds, before anything is made of it; STL, OBJ and VTP (PLY is in `ply`)."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from naris.errors import MachineError, SurfaceError

_STL_HEADER, _STL_FACET = 84, 50
_SPACE = re.compile(rb"SPACE\s*=\s*([A-Za-z]+)")


@dataclass(frozen=True, eq=False)
class MeshFile:
    """The triangles of a file, as they stand there.

    Attributes:
        vertices: (V, 3) in the unit of the file.
        faces: (F, 3).
        space: what the file says of its coordinates (`LPS`, `RAS`, or a frame of naris), or None.
    """

    vertices: Float[np.ndarray, "v 3"]
    faces: Int[np.ndarray, "f 3"]
    space: str | None = None


def broken(path: Path, kind: str, got: str) -> SurfaceError:
    """The error for a file that is not a whole file of its kind."""
    return SurfaceError(f"a whole {kind} mesh in {path.name}", got, "export the surface again")


def fan(polygons: Iterable[list[int]]) -> Int[np.ndarray, "f 3"]:
    """Triangles of polygons, as fans around their first corners."""
    triangles = [(p[0], p[k], p[k + 1]) for p in polygons for k in range(1, len(p) - 1)]
    return np.array(triangles, dtype=np.int64).reshape(-1, 3)


def space_in(text: bytes) -> str | None:
    """The value of the first `SPACE=…`, as 3D Slicer writes it in headers and comments."""
    found = _SPACE.search(text)
    return found[1].decode().upper() if found else None


def read_stl(path: Path, content: bytes) -> MeshFile:
    """STL, binary or text; corners at the same place become one vertex.

    Raises:
        SurfaceError: if it is not STL, or not all of it.
    """
    facets = int.from_bytes(content[80:84], "little")
    if len(content) >= _STL_HEADER and len(content) == _STL_HEADER + _STL_FACET * facets:
        record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("colour", "<u2")])
        corners = np.frombuffer(content, record, facets, _STL_HEADER)["corners"].astype(np.float64).reshape(-1, 3)
        return _soup(path, corners, space_in(content[:80]))
    if not content[:512].lstrip().lower().startswith(b"solid"):
        if len(content) < _STL_HEADER or _is_text(content):
            raise broken(path, "STL", "something else")
        raise broken(path, "STL", f"{len(content):,} bytes for {facets:,} facets, which it announces")
    if b"endsolid" not in content[-4096:].lower():
        raise broken(path, "STL", "a text that stops before `endsolid`")
    rows = re.findall(rb"vertex\s+(\S+)\s+(\S+)\s+(\S+)", content)
    return _soup(path, _numbers(path, "STL", rows), space_in(content[:512].split(b"facet")[0]))


def read_obj(path: Path, content: bytes) -> MeshFile:
    """Wavefront OBJ: its `v` and `f` lines; polygons become fans of triangles.

    Raises:
        SurfaceError: if it has none of these, or one that cannot be read.
    """
    vertices, polygons = [], []
    for line in content.splitlines():
        words = line.split()
        if words[:1] == [b"v"]:
            vertices.append(words[1:4])
        elif words[:1] == [b"f"]:
            polygons.append([_obj_index(path, word, len(vertices)) for word in words[1:]])
    if not vertices or not polygons:
        raise broken(path, "OBJ", "no `v` or no `f` line")
    if any(len(row) != 3 for row in vertices) or any(len(polygon) < 3 for polygon in polygons):
        raise broken(path, "OBJ", "a `v` or `f` line with fewer than three entries")
    comments = b"\n".join(line for line in content[:4096].splitlines() if line.startswith(b"#"))
    return MeshFile(_numbers(path, "OBJ", vertices), fan(polygons), space_in(comments))


def read_vtp(path: Path, content: bytes) -> MeshFile:
    """VTK XML polygon data, through VTK.

    Raises:
        SurfaceError: if VTK cannot read it.
        MachineError: if VTK is not installed.
    """
    try:
        from vtkmodules.util.numpy_support import vtk_to_numpy
        from vtkmodules.vtkCommonCore import vtkObject
        from vtkmodules.vtkFiltersCore import vtkTriangleFilter
        from vtkmodules.vtkIOXML import vtkXMLPolyDataReader
    except ImportError as missing:
        raise MachineError(
            "the library VTK to read .vtp files", "none installed", "run `pip install 'naris[vtk]'` or convert to PLY"
        ) from missing
    if b"<VTKFile" not in content[:4096] or b"PolyData" not in content[:4096]:
        raise broken(path, "VTP", "something else")
    reader = vtkXMLPolyDataReader()
    reader.SetFileName(str(path))
    triangles = vtkTriangleFilter()
    triangles.PassVertsOff()
    triangles.PassLinesOff()
    triangles.SetInputConnection(reader.GetOutputPort())
    # VTK prints what it cannot read; the error below says it in one sentence.
    display = vtkObject.GetGlobalWarningDisplay()
    vtkObject.GlobalWarningDisplayOff()
    try:
        triangles.Update()
    finally:
        vtkObject.SetGlobalWarningDisplay(display)
    mesh = triangles.GetOutput()
    if reader.GetErrorCode() or not mesh.GetNumberOfPoints() or not mesh.GetNumberOfPolys():
        raise broken(path, "VTP", "a file that VTK cannot read, or one without polygons")
    space = reader.GetOutput().GetFieldData().GetAbstractArray("SPACE")
    return MeshFile(
        vtk_to_numpy(mesh.GetPoints().GetData()).astype(np.float64),
        vtk_to_numpy(mesh.GetPolys().GetConnectivityArray()).astype(np.int64).reshape(-1, 3),
        space.GetValue(0).upper() if space is not None and space.GetNumberOfValues() else None,
    )


def _soup(path: Path, corners: Float[np.ndarray, "c 3"], space: str | None) -> MeshFile:
    if not len(corners) or len(corners) % 3:
        raise broken(path, "STL", f"{len(corners)} corners")
    vertices, index = np.unique(corners, axis=0, return_inverse=True)
    return MeshFile(vertices, index.reshape(-1, 3).astype(np.int64), space)


def _numbers(path: Path, kind: str, rows: list[tuple[bytes, ...]] | list[list[bytes]]) -> Float[np.ndarray, "n 3"]:
    try:
        return np.array([float(word) for row in rows for word in row]).reshape(-1, 3)
    except ValueError as error:
        raise broken(path, kind, "coordinates that are not numbers") from error


def _obj_index(path: Path, word: bytes, vertices: int) -> int:
    try:
        index = int(word.split(b"/")[0])
    except ValueError as error:
        raise broken(path, "OBJ", f"the corner {word.decode(errors='replace')!r}") from error
    # Counted from 1, or back from the last vertex so far; 0 is no vertex.
    return index - 1 if index >= 0 else vertices + index


def _is_text(content: bytes) -> bool:
    return b"\0" not in content[:4096]
