"""Scans in one file: NRRD, NIfTI and MetaImage, all brought to LPS and Hounsfield units.

The header is read and judged before any pixel: a size that no scan has, a geometry that is not told, or a frame that is
not a patient's is refused. NIfTI tells places in RAS, NRRD in what its header names, MetaImage in LPS.
"""

from __future__ import annotations

import logging
import math
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import nibabel
import nrrd
import numpy as np
from jaxtyping import Float, Int, Int16, Num

from naris.core.volume import Volume
from naris.ct.continuity import check_continuity
from naris.ct.metaimage import meta_header, meta_values
from naris.ct.packed import check_payload
from naris.ct.resample import AIR_HU, upright
from naris.ct.scan import MOST_BYTES, MOST_VOXELS, Finding, Scan
from naris.errors import ScanError

log = logging.getLogger(__name__)

_ENDS = {"R": (0, -1), "L": (0, 1), "A": (1, -1), "P": (1, 1), "I": (2, -1), "S": (2, 1)}
_MILLIMETRES = {"meter": 1000.0, "mm": 1.0, "micron": 1e-3, "unknown": 1.0}
_SKEWED_DEG = 0.1
_GZIP = b"\x1f\x8b"
_PACKED = {"raw": None, "gzip": "gzip", "gz": "gzip", "bzip2": "bzip2", "bz2": "bzip2"}
_NRRD_TYPES = {
    1: ("char", "uchar", "int8", "uint8"),
    2: ("short", "ushort", "int16", "uint16"),
    4: ("int", "uint", "int32", "uint32", "float"),
    8: ("longlong", "ulonglong", "long long", "int64", "uint64", "double"),
}
_AFFINE_DIFFERS_MM = 0.5


def read_file(path: Path) -> Scan:
    """The scan in a .nrrd, .nii, .nii.gz, .mha or .mhd file.

    Raises:
        ScanError: if it is none, breaks off, is too large, or does not say where in the patient its voxels are.
    """
    kind, read = _reader(path)
    if path.is_file() and not path.stat().st_size:
        raise ScanError(f"a whole {kind} file {path.name}", "an empty one", "copy or export it anew")
    try:
        with _silent(nibabel.imageglobals.logger):
            values, matrix, findings = read(path)
    except ScanError:
        raise
    except (OSError, EOFError, ValueError, RuntimeError, KeyError, StopIteration, TypeError, zlib.error) as error:
        if "allocat" in str(error).replace(str(path), ""):
            raise MemoryError("not enough for a library") from error
        raise _damaged(path, kind, error) from error
    except (nrrd.NRRDError, nibabel.filebasedimages.ImageFileError, nibabel.spatialimages.HeaderDataError) as error:
        raise _damaged(path, kind, error) from error
    values, matrix, lacking = _with_numbers(values, matrix, path)
    findings += lacking
    volume = Volume(_as_hu(values), matrix)
    slice_mm = float(volume.spacing_mm.max())
    for axis in sorted({_LAST_AXIS, _slice_axis(volume)}):
        findings += check_continuity(volume.hu, axis)
    if volume.skew_deg > _SKEWED_DEG:
        text = f"the axes were {volume.skew_deg:.1f}° off right angles; the scan was resampled"
        findings = [*findings, Finding("tilt", text, "warning")]
        volume = upright(volume)
    return Scan(volume, kind, slice_mm, tuple(findings))


@contextmanager
def _silent(logger: logging.Logger) -> Iterator[None]:
    """nibabel tells on stderr what it mends in a header, whoever asked it."""
    before, logger.disabled = logger.disabled, True
    try:
        yield
    finally:
        logger.disabled = before


_LACKING = 0.5  # of a plane
_LAST_AXIS = 2
"""Along which programs that turn DICOM into files put the slices, however thin these are."""


def _slice_axis(volume: Volume) -> int:
    """The axis along which slices lie furthest apart; the last of those where voxels are cubes."""
    return 2 - int(np.argmax(np.round(volume.spacing_mm[::-1], 3)))


_Read = tuple[Num[np.ndarray, "ni nj nk"], Float[np.ndarray, "4 4"], list[Finding]]


def _reader(path: Path) -> tuple[str, Callable[[Path], _Read]]:
    name = path.name.lower()
    if name.endswith((".nii", ".nii.gz")):
        return "NIfTI", _nifti
    if name.endswith(".nrrd"):
        return "NRRD", _nrrd
    if name.endswith((".mha", ".mhd")):
        return "MetaImage", _meta_image
    raise ScanError("a DICOM folder or a file .nrrd, .nii, .nii.gz, .mha or .mhd", path.name, "convert it to one")


def _nifti(path: Path) -> _Read:
    image: Any = nibabel.load(path)
    header: Any = image.header
    shape = [int(n) for n in header.get_data_shape()]
    _check_wrapped(path, shape)
    _check_size(path, shape, header.get_data_dtype().itemsize)
    if not int(header["sform_code"]) and not int(header["qform_code"]):
        raise ScanError(
            f"an sform or a qform in {path.name}, which say where the voxels are",
            "neither of them",
            "convert the scan again from DICOM",
        )
    findings: list[Finding] = []
    affine = np.asarray(image.affine, dtype=np.float64)
    if int(header["sform_code"]) and int(header["qform_code"]):
        corner = np.append(np.array(header.get_data_shape()[:3]) - 1, 1)
        apart = float(np.linalg.norm((affine - header.get_qform()) @ corner))
        if apart > _AFFINE_DIFFERS_MM:
            text = f"sform and qform put the last voxel {apart:.1f} mm apart; the sform was taken"
            findings.append(Finding("two geometries", text, "warning"))
    unit = header.get_xyzt_units()[0]
    scale = np.diag([-1.0, -1.0, 1.0, 1.0]) * _MILLIMETRES[unit]
    scale[3, 3] = 1.0
    if unit == "unknown":
        findings.append(Finding("unit", "the unit of length is not told; it was taken for mm"))
    stored: Any = image.dataobj
    size = math.prod(shape) * stored.dtype.itemsize
    _check_nifti_payload(path, int(stored.offset) + size)
    as_stored = float(stored.slope) == 1 and float(stored.inter) == 0
    values = np.asanyarray(stored) if as_stored else image.get_fdata(caching="unchanged", dtype=np.float32)
    return values.reshape(shape[:3]), scale @ affine, findings


def _check_wrapped(path: Path, shape: Sequence[int]) -> None:
    """NIfTI-1 counts voxels in 16 bits with a sign: more than it can count come out below zero."""
    if min(shape, default=0) < 0:
        told = "×".join(str(n % 2**16) for n in shape)
        raise ScanError(
            f"at most {2**15 - 1:,} voxels along an axis in {path.name}, as NIfTI-1 can count", told, "check the file"
        )


def _check_nifti_payload(path: Path, size: int) -> None:
    with path.open("rb") as file:
        packed = "gzip" if file.read(2) == _GZIP else None
    check_payload(path, 0, size, packed)


def _nrrd(path: Path) -> _Read:
    with path.open("rb") as file:
        if file.read(4) != b"NRRD":
            raise ScanError(f"an NRRD file {path.name}", "one that does not begin with NRRD", "check what it is")
        file.seek(0)
        header = nrrd.read_header(file)
        start = file.tell()
    sizes, bytes_each = [int(n) for n in header.get("sizes", ())], _bytes_each(path, str(header.get("type")))
    _check_size(path, sizes, bytes_each)
    if "data file" in header or "datafile" in header:
        raise ScanError(f"a scan in {path.name} itself", "a header of another file", "save it as one .nrrd file")
    if header.get("space") is None or header.get("space directions") is None or header.get("space origin") is None:
        raise ScanError(
            f"space, space directions and space origin in {path.name}, which say where the voxels are",
            "a header without all of them",
            "save the scan again with its geometry",
        )
    turn = _to_lps(path, str(header["space"]))
    matrix = np.eye(4)
    matrix[:3, :3] = turn @ np.asarray(header["space directions"], dtype=np.float64).T
    matrix[:3, 3] = turn @ np.asarray(header["space origin"], dtype=np.float64)
    encoding = str(header.get("encoding")).lower()
    if any(int(header.get(skip, 0)) for skip in ("line skip", "lineskip", "byte skip", "byteskip")):
        raise ScanError(f"values right behind the header in {path.name}", "some to skip", "save it as one .nrrd file")
    if encoding in _PACKED:
        check_payload(path, start, math.prod(sizes) * bytes_each, _PACKED[encoding])
    values, _ = nrrd.read(str(path))
    return values, matrix, []


def _bytes_each(path: Path, kind: str) -> int:
    """How many bytes an NRRD type such as `unsigned short` or `int16_t` has."""
    plain = kind.lower().removeprefix("unsigned ").removeprefix("signed ").removesuffix(" int").removesuffix("_t")
    for size, names in _NRRD_TYPES.items():
        if plain in names:
            return size
    raise ScanError(f"numbers of a known type in {path.name}", f"type {kind[:40]}", "save the scan again as short")


def _meta_image(path: Path) -> _Read:
    header = meta_header(path)
    _check_size(path, header.sizes, header.kind.itemsize)
    return meta_values(header), header.matrix, []


def _check_size(path: Path, shape: Sequence[int], bytes_each: int) -> None:
    """Three axes of more than one voxel (later ones of one), and no more voxels than a scan has."""
    sizes = [int(n) for n in shape]
    told = "×".join(map(str, sizes)) or "no size"
    if len(sizes) < 3 or min(sizes[:3]) < 2 or any(n != 1 for n in sizes[3:]):
        raise ScanError(f"a scan with three axes in {path.name}", told, "give a whole CT")
    if float(np.prod([float(n) for n in sizes])) > MOST_VOXELS:
        raise ScanError(f"a scan of at most {MOST_VOXELS:,} voxels in {path.name}", told, "crop it or check the file")
    if math.prod(sizes) * bytes_each > MOST_BYTES:
        told += f" of {bytes_each} bytes"
        raise ScanError(f"at most {MOST_BYTES:,} bytes of values in {path.name}", told, "save it as short, or crop it")


def _to_lps(path: Path, space: str) -> Float[np.ndarray, "3 3"]:
    """The matrix that takes a patient's frame such as `left-anterior-superior` or `LAS` to LPS."""
    words = space.split("-")
    code = (space if len(words) == 1 else "".join(word[:1] for word in words)).upper()
    turn = np.zeros((3, 3))
    for column, end in enumerate(code if len(code) == 3 else ""):
        if end in _ENDS:
            axis, sign = _ENDS[end]
            turn[axis, column] = sign
    if abs(np.linalg.det(turn)) != 1:
        raise ScanError(
            f"a patient's frame such as left-posterior-superior in {path.name}",
            f"space {space}",
            "save the scan again in LPS or RAS",
        )
    return turn


def _as_hu(values: Num[np.ndarray, "ni nj nk"]) -> Int16[np.ndarray, "ni nj nk"]:
    if values.dtype == np.int16:
        return values
    limits = np.iinfo(np.int16)
    out = np.empty(values.shape, np.int16, order="F" if values.flags.f_contiguous else "C")
    for k in range(values.shape[2]):  # slice by slice: several copies of a whole scan do not fit everywhere
        real = values[:, :, k].astype(np.float64)
        finite = np.where(np.isfinite(real), real, AIR_HU)
        out[:, :, k] = np.rint(np.clip(finite, limits.min, limits.max))
    return out


def _with_numbers(
    values: Num[np.ndarray, "ni nj nk"], matrix: Float[np.ndarray, "4 4"], path: Path
) -> tuple[Num[np.ndarray, "nl nm nn"], Float[np.ndarray, "4 4"], list[Finding]]:
    """Without the planes at its sides that have hardly a number, as a scan that was turned has; and a warning.

    Raises:
        ScanError: if such planes lie between others, or there are no others: they would be taken for air.
    """
    if not np.issubdtype(values.dtype, np.floating):
        return values, matrix, []
    lacking = [np.zeros(n, np.int64) for n in values.shape]
    for k in range(values.shape[2]):  # slice by slice: several copies of a whole scan do not fit everywhere
        lacks = ~np.isfinite(values[:, :, k])
        lacking[0] += lacks.sum(axis=1)
        lacking[1] += lacks.sum(axis=0)
        lacking[2][k] = lacks.sum()
    if not lacking[2].any():
        return values, matrix, []
    kept = [_between_numbers(one, values.size // len(one), path) for one in lacking]
    moved = matrix.copy()
    moved[:3, 3] += matrix[:3, :3] @ [one.start for one in kept]
    told = f"{lacking[2].sum():,} voxels are no numbers (NaN or infinite) and were read as air"
    if (left_out := sum(values.shape) - sum(one.stop - one.start for one in kept)) > 0:
        told += f"; {left_out} planes at the sides that are mostly so were left out"
    return values[tuple(kept)], moved, [Finding("no numbers", told, "warning")]


def _between_numbers(lacking: Int[np.ndarray, "n"], size: int, path: Path) -> slice:
    """The planes from the first to the last with enough numbers."""
    is_full = lacking <= _LACKING * size
    full = np.flatnonzero(is_full)
    kept = slice(int(full[0]), int(full[-1]) + 1) if len(full) else slice(0, 0)
    if not len(full) or not is_full[kept].all():
        told = f"{(~is_full).sum()} of {len(is_full)} planes without"
        if len(full):
            told += f", number {kept.start + int(np.argmin(is_full[kept]))} among them"
        raise ScanError(
            f"numbers, not NaN, in every slice of {path.name}", told, "leave such slices out, or export the scan anew"
        )
    return kept


def _damaged(path: Path, kind: str, error: Exception) -> ScanError:
    """In our words: what libraries say is made for their authors, and names places where they were built."""
    log.debug("%s from a library", type(error).__name__)  # whose text may quote the header
    return ScanError(
        f"a whole {kind} file {path.name}", "one that is damaged, or something else", "copy or export it anew"
    )
