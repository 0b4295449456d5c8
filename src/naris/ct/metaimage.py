"""MetaImage files (.mha, .mhd), read here: the library made for them prints, and damaged headers make it crash."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Num

from naris.ct.packed import check_payload, pieces
from naris.errors import ScanError

_MOST_HEADER = 2**16
_LAST = "ElementDataFile"
_TYPES = {
    "MET_CHAR": "i1", "MET_UCHAR": "u1", "MET_SHORT": "i2", "MET_USHORT": "u2", "MET_INT": "i4", "MET_UINT": "u4",
    "MET_LONG": "i4", "MET_ULONG": "u4", "MET_LONG_LONG": "i8", "MET_ULONG_LONG": "u8", "MET_FLOAT": "f4",
    "MET_DOUBLE": "f8",
}  # fmt: skip
_DIRECTIONS, _ORIGINS = ("TransformMatrix", "Rotation", "Orientation"), ("Offset", "Position", "Origin")


@dataclass(frozen=True, eq=False)
class MetaHeader:
    """What a MetaImage header says.

    Attributes:
        sizes: voxels along each axis.
        kind: of the values, with their byte order.
        matrix: (4, 4) from (i, j, k, 1) to mm in LPS.
        values_in: the file with the values: the same one, or one beside it.
        start: the byte of it that they begin at.
        packed: whether by zlib.
    """

    sizes: tuple[int, int, int]
    kind: np.dtype
    matrix: Float[np.ndarray, "4 4"]
    values_in: Path
    start: int
    packed: bool


def meta_header(path: Path) -> MetaHeader:
    """The header of a .mha or .mhd file.

    Raises:
        ScanError: if it is none, does not say where the voxels are, or names values that are not one file beside it.
    """
    words, end = _words(path)
    if not _yes(words, "BinaryData", True) or words.get("ElementNumberOfChannels", "1") != "1":
        raise ScanError(f"one binary value a voxel in {path.name}", "text or several", "give the CT itself")
    try:
        sizes = tuple(int(word) for word in words["DimSize"].split())
        order = (
            ">" if _yes(words, "BinaryDataByteOrderMSB", False) or _yes(words, "ElementByteOrderMSB", False) else "<"
        )
        kind = np.dtype(order + _TYPES[words["ElementType"]])
        skipped = int(words.get("HeaderSize", "0"))
    except (KeyError, ValueError) as error:
        raise _none(path, "one without a whole DimSize or ElementType") from error
    if len(sizes) != 3:
        raise ScanError(f"a scan with three axes in {path.name}", words["DimSize"][:40] or "none", "give a whole CT")
    values_in = _values_in(path, words[_LAST])
    start = end if values_in == path else skipped
    if start < 0:
        start = max(values_in.stat().st_size - math.prod(sizes) * kind.itemsize, 0)
    return MetaHeader(sizes, kind, _matrix(path, words), values_in, start, _yes(words, "CompressedData", False))


def meta_values(header: MetaHeader) -> Num[np.ndarray, "ni nj nk"]:
    """The values of a file whose header has been read.

    Raises:
        ScanError: if there are fewer or more than the header says.
    """
    size = math.prod(header.sizes) * header.kind.itemsize
    check_payload(header.values_in, header.start, size, "zlib" if header.packed else None)
    with header.values_in.open("rb") as file:
        file.seek(header.start)
        data = b"".join(pieces(file, "zlib")) if header.packed else file.read(size)
    values = np.frombuffer(data, header.kind, math.prod(header.sizes)).reshape(header.sizes, order="F")
    return values.astype(header.kind.newbyteorder("="), copy=False)


def _values_in(path: Path, name: str) -> Path:
    if name.upper() == "LOCAL":
        return path
    if Path(name).name != name or not (path.parent / name).is_file():
        raise ScanError(f"the values of {path.name} in one file beside it", name[:60], "put it there")
    return path.parent / name


def _matrix(path: Path, words: Mapping[str, str]) -> Float[np.ndarray, "4 4"]:
    """The file lists the direction of each axis, one after another."""
    try:
        directions = _numbers(words, _DIRECTIONS, 9).reshape(3, 3).T
        matrix = np.eye(4)
        matrix[:3, :3] = directions * _numbers(words, ("ElementSpacing",), 3)
        matrix[:3, 3] = _numbers(words, _ORIGINS, 3)
    except ValueError as error:
        raise ScanError(
            f"TransformMatrix, Offset and ElementSpacing in {path.name}, which say where the voxels are",
            "a header without all of them",
            "save the scan again with its geometry",
        ) from error
    return matrix


def _numbers(words: Mapping[str, str], names: tuple[str, ...], count: int) -> Float[np.ndarray, "n"]:
    text = next((words[name] for name in names if name in words), "")
    numbers = np.array([float(word) for word in text.split()])
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise ValueError(f"{count} numbers wanted")
    return numbers


def _yes(words: Mapping[str, str], name: str, otherwise: bool) -> bool:
    return words.get(name, str(otherwise)).lower() in ("true", "1")


def _words(path: Path) -> tuple[Mapping[str, str], int]:
    """The header's `key = value` lines, and the byte that they end at."""
    with path.open("rb") as file:
        head = file.read(_MOST_HEADER)
    words: dict[str, str] = {}
    at = 0
    for line in head.splitlines(keepends=True):
        at += len(line)
        key, equals, value = line.decode("latin-1").partition("=")
        if not equals:
            break
        words[key.strip()] = value.strip()
        ends = line.endswith((b"\n", b"\r")) or len(head) < _MOST_HEADER  # a text editor may leave the last line open
        if key.strip() == _LAST and value.strip() and ends:
            return words, at
    raise _none(path, "one that names no ElementDataFile")


def _none(path: Path, got: str) -> ScanError:
    return ScanError(f"a whole MetaImage header in {path.name}", got, "copy or export it anew")
