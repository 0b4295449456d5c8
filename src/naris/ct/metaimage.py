"""The header of a MetaImage file: judged here first, since the library that reads the values talks past Python."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from naris.ct.packed import check_payload
from naris.errors import ScanError

_MOST_HEADER = 2**16
_LAST = "ElementDataFile"
_BYTES = {
    "MET_CHAR": 1, "MET_UCHAR": 1, "MET_SHORT": 2, "MET_USHORT": 2, "MET_INT": 4, "MET_UINT": 4, "MET_LONG": 4,
    "MET_ULONG": 4, "MET_LONG_LONG": 8, "MET_ULONG_LONG": 8, "MET_FLOAT": 4, "MET_DOUBLE": 8,
}  # fmt: skip


@dataclass(frozen=True)
class MetaHeader:
    """What a MetaImage header says of its values.

    Attributes:
        sizes: voxels along each axis.
        channels: values a voxel.
        bytes_each: of a value.
        values_in: the file with the values: the same one, or one beside it.
        start: the byte of it that they begin at.
        packed: zlib, or None.
        binary: not written as text.
    """

    sizes: tuple[int, ...]
    channels: int
    bytes_each: int
    values_in: Path
    start: int
    packed: str | None
    binary: bool


def meta_header(path: Path) -> MetaHeader:
    """The header of a .mha or .mhd file.

    Raises:
        ScanError: if it is none, or one that names values which are not one file beside it.
    """
    words, end = _words(path)
    try:
        sizes = tuple(int(word) for word in words["DimSize"].split())
        channels = int(words.get("ElementNumberOfChannels", "1"))
        bytes_each = _BYTES[words["ElementType"].split()[0].removesuffix("_ARRAY")]
        skipped = int(words.get("HeaderSize", "0"))
    except (KeyError, ValueError, IndexError) as error:
        raise _none(path, "one without a whole DimSize or ElementType") from error
    name = words[_LAST]
    local = name.upper() == "LOCAL"
    values_in = path if local else path.parent / name
    if not local and (Path(name).name != name or not values_in.is_file()):
        raise ScanError(f"the values of {path.name} in one file beside it", name[:60], "put it there")
    packed = "zlib" if words.get("CompressedData", "False").lower() in ("true", "1") else None
    size = math.prod(sizes) * channels * bytes_each
    start = end if local else max(values_in.stat().st_size - size, 0) if skipped < 0 else skipped
    binary = words.get("BinaryData", "True").lower() in ("true", "1")
    return MetaHeader(sizes, channels, bytes_each, values_in, start, packed, binary)


def check_values_are_there(header: MetaHeader) -> None:
    """See that there are as many bytes of values as the header says.

    Raises:
        ScanError: if there are fewer or more.
    """
    if header.binary:
        size = math.prod(header.sizes) * header.channels * header.bytes_each
        check_payload(header.values_in, header.start, size, header.packed)


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
        if key.strip() == _LAST and value.strip() and line.endswith((b"\n", b"\r")):
            return words, at
    raise _none(path, "one that names no ElementDataFile")


def _none(path: Path, got: str) -> ScanError:
    return ScanError(f"a whole MetaImage header in {path.name}", got, "copy or export it anew")
