"""Packed values, unpacked piece by piece, so that a small file cannot fill the memory: what it grows to is bounded."""

from __future__ import annotations

import bz2
import io
import zlib
from collections.abc import Iterator
from pathlib import Path

import pydicom
from pydicom.filebase import DicomFileLike
from pydicom.filereader import read_file_meta_info
from pydicom.filewriter import write_file_meta_info
from pydicom.uid import DeflatedExplicitVRLittleEndian, ExplicitVRLittleEndian

from naris.ct.scan import MOST_BYTES
from naris.errors import ScanError

_CHUNK = 2**20
_BITS = {"gzip": zlib.MAX_WBITS | 16, "zlib": zlib.MAX_WBITS, "deflate": -zlib.MAX_WBITS}
_PADDING = 4096  # bytes behind the values that some programs and tapes leave
_PREAMBLE = b"\0" * 128 + b"DICM"
_MOST_HEADER = 2**24
_META_WITHIN = 2**12


def pieces(file: io.BufferedIOBase, kind: str) -> Iterator[bytes]:
    """What gzip, zlib, deflate or bzip2 packed, from where the file stands, at most 1 MiB at a time.

    Raises:
        EOFError: if it breaks off.
        zlib.error, OSError: if it is damaged.
    """
    if kind == "bzip2":
        unzip = bz2.BZ2Decompressor()
        while not unzip.eof:
            packed = file.read(_CHUNK) if unzip.needs_input else b""
            if unzip.needs_input and not packed:
                raise EOFError("packed values break off")
            yield unzip.decompress(packed, _CHUNK)
        return
    inflate, packed = zlib.decompressobj(_BITS[kind]), file.read(_CHUNK)
    while packed:
        yield inflate.decompress(packed, _CHUNK)
        packed = inflate.unused_data if inflate.eof else inflate.unconsumed_tail
        packed = packed or file.read(_CHUNK)
        if inflate.eof:
            if kind != "gzip" or packed[:2] != b"\x1f\x8b":
                return
            inflate = zlib.decompressobj(_BITS[kind])  # some programs pack in several parts
    raise EOFError("packed values break off")


def check_payload(path: Path, start: int, expected: int, kind: str | None) -> None:
    """See that a file holds, from a byte on, packed in a way or plain, as many bytes as its header asks for.

    Raises:
        ScanError: if it holds fewer or more: before more than a piece beyond them has been unpacked.
    """
    size = 0
    with path.open("rb") as file:
        file.seek(start)
        if kind is None:
            size = max(path.stat().st_size - start, 0)
        else:
            try:
                for piece in pieces(file, kind):
                    size += len(piece)
                    if size > expected + _PADDING:
                        break
            except EOFError:
                size = min(size, expected - 1)
    if size > expected + _PADDING:
        raise ScanError(f"{expected:,} bytes of values in {path.name}, as its header says", "more", "check the file")
    if size < expected:
        told = f"{size:,}" if size else "none"
        raise ScanError(f"{expected:,} bytes of values in {path.name}, as its header says", told, "copy it anew")


def dicom_header(path: Path) -> Path | io.BytesIO:
    """What to read the header of a DICOM file from; of a deflated one no more than headers have is unpacked."""
    return path if (start := _deflated_from(path)) is None else _inflated(path, start, _MOST_HEADER, whole=False)


def dicom_whole(path: Path) -> Path | io.BytesIO:
    """What to read a whole DICOM file from; a deflated one is unpacked as far as its header says that there are pixels.

    Raises:
        ScanError: if there is more.
    """
    if (start := _deflated_from(path)) is None:
        return path
    header = pydicom.dcmread(dicom_header(path), stop_before_pixels=True)
    pixels = int(header.Rows) * int(header.Columns) * int(header.get("NumberOfFrames") or 1)
    most = min(pixels * int(header.BitsAllocated) // 8, MOST_BYTES) + _MOST_HEADER
    return _inflated(path, start, most, whole=True)


def _deflated_from(path: Path) -> int | None:
    """Where the deflated part of a DICOM file begins; None if it has none."""
    with path.open("rb") as file:
        if DeflatedExplicitVRLittleEndian.encode() not in file.read(_META_WITHIN):
            return None
    meta = read_file_meta_info(path)
    if meta.TransferSyntaxUID != DeflatedExplicitVRLittleEndian:
        return None
    length = meta["FileMetaInformationGroupLength"]
    return len(_PREAMBLE) + 12 + int(length.value)


def _inflated(path: Path, start: int, most: int, whole: bool) -> io.BytesIO:
    """The same DICOM file as it was before it was deflated, or the first of it."""
    meta = read_file_meta_info(path)
    meta.TransferSyntaxUID = ExplicitVRLittleEndian
    out = io.BytesIO()
    out.write(_PREAMBLE)
    write_file_meta_info(DicomFileLike(out), meta, enforce_standard=False)
    size = 0
    with path.open("rb") as file:
        file.seek(start)
        try:
            for piece in pieces(file, "deflate"):
                out.write(piece)
                size += len(piece)
                if size > most:
                    break
        except zlib.error as error:
            raise EOFError("packed values are damaged") from error
    if size > most and whole:
        raise ScanError(
            f"at most {most:,} bytes in {path.name}, as its header says", "more once it is unpacked", "check the file"
        )
    out.seek(0)
    return out
