"""Scans in one file: NRRD, NIfTI and MetaImage, all brought to LPS and Hounsfield units.

The header is read and judged before any pixel: a size that no scan has, a geometry that is not told, or a frame that is
not a patient's is refused. NIfTI tells places in RAS, NRRD in what its header names, MetaImage in LPS.
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import nibabel
import nrrd
import numpy as np
import SimpleITK as sitk
from jaxtyping import Float, Int16, Num

from naris.core.volume import Volume
from naris.ct.continuity import check_continuity
from naris.ct.resample import upright
from naris.ct.scan import MOST_VOXELS, Finding, Scan
from naris.errors import ScanError

_ENDS = {"R": (0, -1), "L": (0, 1), "A": (1, -1), "P": (1, 1), "I": (2, -1), "S": (2, 1)}
_MILLIMETRES = {"meter": 1000.0, "mm": 1.0, "micron": 1e-3, "unknown": 1.0}
_SKEWED_DEG = 0.1
_CHUNK = 2**20
_AFFINE_DIFFERS_MM = 0.5


def read_file(path: Path) -> Scan:
    """The scan in a .nrrd, .nii, .nii.gz, .mha or .mhd file.

    Raises:
        ScanError: if it is none, breaks off, is too large, or does not say where in the patient its voxels are.
    """
    kind, read = _reader(path)
    try:
        values, matrix, findings = read(path)
    except ScanError:
        raise
    except (OSError, EOFError, ValueError, RuntimeError, KeyError, StopIteration, TypeError, zlib.error) as error:
        raise _damaged(path, kind, error) from error
    except (nrrd.NRRDError, nibabel.filebasedimages.ImageFileError, nibabel.spatialimages.HeaderDataError) as error:
        raise _damaged(path, kind, error) from error
    volume = Volume(_as_hu(values), matrix)
    slice_mm = float(volume.spacing_mm.max())
    findings += check_continuity(volume.hu, _slice_axis(volume))
    if volume.skew_deg > _SKEWED_DEG:
        text = f"the axes were {volume.skew_deg:.1f}° off right angles; the scan was resampled"
        findings = [*findings, Finding("tilt", text, "warning")]
        volume = upright(volume)
    return Scan(volume, kind, slice_mm, tuple(findings))


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
    image = nibabel.load(path)
    header: Any = image.header
    _check_size(path, header.get_data_shape())
    if not int(header["sform_code"]) and not int(header["qform_code"]):
        raise ScanError(
            f"an sform or a qform in {path.name}, which say where the voxels are",
            "neither of them",
            "convert the scan again from DICOM",
        )
    findings: list[Finding] = []
    affine = np.asarray(image.affine, dtype=np.float64)  # type: ignore[attr-defined]
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
    return np.asanyarray(image.dataobj).reshape(header.get_data_shape()[:3]), scale @ affine, findings  # type: ignore[attr-defined]


def _nrrd(path: Path) -> _Read:
    with path.open("rb") as file:
        header = nrrd.read_header(file)
        start = file.tell()
    _check_size(path, [int(n) for n in header.get("sizes", ())])
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
    if header.get("encoding") in ("gzip", "gz"):
        _check_unpacked(path, start, int(np.prod(header["sizes"])) * 8)
    values, _ = nrrd.read(str(path))
    return values, matrix, []


def _meta_image(path: Path) -> _Read:
    sitk.ProcessObject.SetGlobalWarningDisplay(False)
    reader = sitk.ImageFileReader()
    reader.SetFileName(str(path))
    reader.ReadImageInformation()
    _check_size(path, reader.GetSize())
    if reader.GetNumberOfComponents() != 1:
        raise ScanError(f"one value a voxel in {path.name}", f"{reader.GetNumberOfComponents()}", "give the CT itself")
    image = reader.Execute()
    matrix = np.eye(4)
    matrix[:3, :3] = np.array(image.GetDirection()).reshape(3, 3) * image.GetSpacing()
    matrix[:3, 3] = image.GetOrigin()
    return sitk.GetArrayFromImage(image).transpose(2, 1, 0), matrix, []


def _check_size(path: Path, shape: Sequence[int]) -> None:
    """Three axes of more than one voxel (later ones of one), and no more voxels than a scan has."""
    sizes = [int(n) for n in shape]
    told = "×".join(map(str, sizes)) or "no size"
    if len(sizes) < 3 or min(sizes[:3]) < 2 or any(n != 1 for n in sizes[3:]):
        raise ScanError(f"a scan with three axes in {path.name}", told, "give a whole CT")
    if float(np.prod([float(n) for n in sizes])) > MOST_VOXELS:
        raise ScanError(f"a scan of at most {MOST_VOXELS:,} voxels in {path.name}", told, "crop it or check the file")


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


def _check_unpacked(path: Path, start: int, most: int) -> None:
    """See that packed data do not grow beyond what the header asks for, before a library unpacks all of them."""
    unpacker = zlib.decompressobj(zlib.MAX_WBITS | 16)
    size = 0
    with path.open("rb") as file:
        file.seek(start)
        while packed := (unpacker.unconsumed_tail or file.read(_CHUNK)):
            size += len(unpacker.decompress(packed, _CHUNK))
            if size > most:
                raise ScanError(
                    f"at most {most:,} bytes of values in {path.name}, as its header says", "more", "check the file"
                )


def _as_hu(values: Num[np.ndarray, "ni nj nk"]) -> Int16[np.ndarray, "ni nj nk"]:
    if values.dtype == np.int16:
        return values
    limits = np.iinfo(np.int16)
    finite = np.nan_to_num(values.astype(np.float32, copy=False), nan=limits.min, posinf=limits.max, neginf=limits.min)
    return np.rint(np.clip(finite, limits.min, limits.max)).astype(np.int16)


def _damaged(path: Path, kind: str, error: Exception) -> ScanError:
    clause = str(error).split("\n", 1)[0].replace(str(path), path.name).rstrip(".")[:120] or type(error).__name__
    return ScanError(f"a whole {kind} file {path.name}", f"a damaged one ({clause})", "copy or export it anew")
