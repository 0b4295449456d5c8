"""PLY: the Stanford polygon format, text or binary, as far as triangles go.

`comment SPACE=LPS` (or `RAS`) says, as in 3D Slicer, what the coordinates are; `comment FRAME=…` names any other frame.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int

from naris.anatomy.mesh_files import MeshFile, broken, fan, space_in
from naris.core.anatomy import Anatomy
from naris.core.atomic import write_bytes

_XYZ = ("x", "y", "z")
_LONGEST_HEADER = 65536
_DIGITS = 16
_TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
_ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
_FRAME = re.compile(rb"^comment FRAME=(\S+)\s*$", re.MULTILINE)


@dataclass(frozen=True)
class _Property:
    name: str
    type: str
    count_type: str | None = None


@dataclass(frozen=True)
class _Element:
    name: str
    count: int
    properties: tuple[_Property, ...]

    @property
    def fixed(self) -> bool:
        return all(p.count_type is None for p in self.properties)


def read_ply(path: Path, content: bytes) -> MeshFile:
    """The vertices and faces of a PLY file; polygons become fans of triangles, everything else is passed over.

    Raises:
        SurfaceError: if it is not PLY, not all of it, or has no faces.
    """
    vertices, faces, header = _elements(path, content)
    if faces is None or not len(faces):
        raise broken(path, "PLY", "no faces (a cloud of points?)")
    frame = _FRAME.search(header)
    return MeshFile(vertices, faces, frame[1].decode("utf-8", "replace") if frame else space_in(header))


def read_ply_points(path: Path, content: bytes, *, normals: bool = False) -> Float[np.ndarray, "v c"]:
    """The vertices of a PLY file, with faces or without; x, y and z, and with `normals` nx, ny and nz behind them.

    Raises:
        SurfaceError: if it is not PLY, not all of it, or has no vertices of that kind.
    """
    return _elements(path, content, (*_XYZ, "nx", "ny", "nz") if normals else _XYZ)[0]


def _elements(
    path: Path, content: bytes, axes: tuple[str, ...] = _XYZ
) -> tuple[Float[np.ndarray, "v c"], Int[np.ndarray, "f 3"] | None, bytes]:
    """Those properties of the vertices, faces if there are some, and the header."""
    header, body = _split(path, content)
    order, elements = _parse_header(path, header)
    rows: _TextRows | _BinaryRows = _BinaryRows(path, body, order) if order else _TextRows(path, body)
    vertices, faces = None, None
    for element in elements:
        if element.name == "vertex":
            names = [p.name for p in element.properties]
            if not element.fixed or not set(axes) <= set(names):
                raise broken(path, "PLY", f"vertices without {', '.join(axes[:-1])} and {axes[-1]}")
            vertices = rows.table(element)[:, [names.index(axis) for axis in axes]]
        elif element.name == "face":
            faces = rows.polygons(element)
        elif vertices is None or faces is None:
            rows.table(element) if element.fixed else rows.polygons(element)
    if vertices is None:
        raise broken(path, "PLY", "no vertices")
    return vertices, faces, header


def write_surface(anatomy: Anatomy, path: Path | str) -> None:
    """Writes the surface as binary PLY, atomically, with its frame: `comment SPACE=LPS`, or `comment FRAME=…`.

    Coordinates are mm, in single precision where that loses nothing and else in double, so reading gives the same bits.

    Raises:
        DiskFull: if there is no room.
    """
    write_bytes(Path(path), ply_bytes(anatomy))


def ply_bytes(anatomy: Anatomy) -> bytes:
    """The content of the file that `write_surface` writes."""
    exact = bool((anatomy.vertices_mm.astype(np.float32) == anatomy.vertices_mm).all())
    number, kind = ("float", "<f4") if exact else ("double", "<f8")
    name = " ".join(anatomy.name.split())
    header = [
        "ply",
        "format binary_little_endian 1.0",
        f"comment {name}, in mm" if name.isascii() else "comment in mm",
        "comment SPACE=LPS" if anatomy.frame == "LPS" else f"comment FRAME={anatomy.frame}",
        f"element vertex {len(anatomy.vertices_mm)}",
        *(f"property {number} {axis}" for axis in "xyz"),
        f"element face {len(anatomy.faces)}",
        "property list uchar int vertex_indices",
        "end_header\n",
    ]
    faces = np.empty(len(anatomy.faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, anatomy.faces
    return "\n".join(header).encode() + anatomy.vertices_mm.astype(kind).tobytes() + faces.tobytes()


def _split(path: Path, content: bytes) -> tuple[bytes, bytes]:
    if not re.match(rb"ply\s", content):
        raise broken(path, "PLY", "a file that does not begin with `ply`")
    end = re.search(rb"^end_header[ \t]*\r?\n?", content[:_LONGEST_HEADER], re.MULTILINE)
    if end is None:
        raise broken(path, "PLY", "a header without end")
    return content[: end.start()].replace(b"\r\n", b"\n"), content[end.end() :]


def _parse_header(path: Path, header: bytes) -> tuple[str, list[_Element]]:
    order: str | None = None
    elements: list[_Element] = []
    for line in header.decode("latin-1").splitlines()[1:]:
        match line.split():
            case ["format", kind, _] if kind in _ORDERS:
                order = _ORDERS[kind]
            case ["element", name, count] if count.isdecimal() and len(count) < _DIGITS:
                elements.append(_Element(name, int(count), ()))
            case ["property", "list", count_type, kind, name] if elements and {count_type, kind} <= _TYPES.keys():
                _add(elements, _Property(name, _TYPES[kind], _TYPES[count_type]))
            case ["property", kind, name] if elements and kind in _TYPES:
                _add(elements, _Property(name, _TYPES[kind]))
            case [] | ["comment", *_] | ["obj_info", *_]:
                pass
            case _:
                raise broken(path, "PLY", f"the header line {line[:60]!r}")
    if order is None:
        raise broken(path, "PLY", "a header without `format`")
    return order, elements


def _add(elements: list[_Element], one: _Property) -> None:
    last = elements[-1]
    elements[-1] = _Element(last.name, last.count, (*last.properties, one))


def _corners(path: Path, element: _Element) -> int:
    """Which property of a face lists its corners."""
    for index, one in enumerate(element.properties):
        if one.name in ("vertex_indices", "vertex_index") and one.count_type:
            return index
    raise broken(path, "PLY", f"{element.name}s without a list of vertex indices")


class _TextRows:
    """The rows of a text file, element after element."""

    def __init__(self, path: Path, body: bytes) -> None:
        self._path, self._words, self._at = path, body.split(), 0

    def table(self, element: _Element) -> Float[np.ndarray, "n p"]:
        words = self._take(element.count * len(element.properties), element)
        return self._numbers(words).reshape(-1, max(len(element.properties), 1))

    def polygons(self, element: _Element) -> Int[np.ndarray, "f 3"]:
        wanted = _corners(self._path, element) if element.name == "face" else -1
        found: list[list[int]] = []
        for _ in range(element.count):
            for index, one in enumerate(element.properties):
                length = 1 if one.count_type is None else self._whole(self._take(1, element))[0]
                words = self._take(max(length, 0), element)
                if index == wanted:
                    found.append(self._whole(words))
        return fan(found)

    def _take(self, count: int, element: _Element) -> list[bytes]:
        words = self._words[self._at : self._at + count]
        if len(words) < count:
            raise broken(self._path, "PLY", f"a file that stops before the last of {element.count:,} {element.name}s")
        self._at += count
        return words

    def _whole(self, words: list[bytes]) -> list[int]:
        try:
            return [int(word) for word in words]
        except ValueError as error:
            raise broken(self._path, "PLY", "words where whole numbers should stand") from error

    def _numbers(self, words: list[bytes]) -> Float[np.ndarray, "n"]:
        try:
            return np.array([float(word) for word in words])
        except ValueError as error:
            raise broken(self._path, "PLY", "words where numbers should stand") from error


class _BinaryRows:
    """The rows of a binary file, element after element."""

    def __init__(self, path: Path, body: bytes, order: str) -> None:
        self._path, self._body, self._order, self._at = path, body, order, 0

    def table(self, element: _Element) -> Float[np.ndarray, "n p"]:
        if not element.properties:
            return np.empty((0, 0))
        record = np.dtype([(f"{i}", self._order + p.type) for i, p in enumerate(element.properties)])
        rows = self._records(record, element.count, element)
        return np.stack([rows[name].astype(np.float64) for name in record.names or ()], axis=1)

    def polygons(self, element: _Element) -> Int[np.ndarray, "f 3"]:
        wanted = _corners(self._path, element) if element.name == "face" else -1
        alone = len(element.properties) == 1 and wanted == 0
        if alone:
            triangles = self._triangles(element)
            if triangles is not None:
                return triangles
        found: list[list[int]] = []
        for _ in range(element.count):
            for index, one in enumerate(element.properties):
                length = 1
                if one.count_type is not None:
                    length = int(self._records(np.dtype(self._order + one.count_type), 1, element)[0])
                values = self._records(np.dtype(self._order + one.type), max(length, 0), element)
                if index == wanted:
                    found.append(values.astype(np.int64).tolist())
        return fan(found)

    def _triangles(self, element: _Element) -> Int[np.ndarray, "f 3"] | None:
        """All faces at once, if each has three corners."""
        one = element.properties[0]
        record = np.dtype([("count", self._order + str(one.count_type)), ("corners", self._order + one.type, 3)])
        if len(self._body) - self._at < record.itemsize * element.count:
            return None
        rows = np.frombuffer(self._body, record, element.count, self._at)
        if (rows["count"] != 3).any():
            return None
        self._at += record.itemsize * element.count
        return rows["corners"].astype(np.int64)

    def _records(self, record: np.dtype, count: int, element: _Element) -> np.ndarray:
        # Before anything is allocated: a header may announce more than there is.
        if len(self._body) - self._at < record.itemsize * count:
            raise broken(self._path, "PLY", f"a file that stops before the last of {element.count:,} {element.name}s")
        rows = np.frombuffer(self._body, record, count, self._at)
        self._at += record.itemsize * count
        return rows
