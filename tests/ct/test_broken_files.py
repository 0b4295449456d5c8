"""Scans in one file that break off, hold more than they say or are none: each is refused in one sentence."""

from __future__ import annotations

import bz2
import contextlib
import gzip
from pathlib import Path

import nibabel
import nrrd
import numpy as np
import pytest
import SimpleITK as sitk
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from naris.ct.files import read_file
from naris.errors import ScanError
from tests.ct.dicom_files import grid
from tests.ct.test_files import affine, write


def broken_by_hand(kind: str, folder: Path) -> Path:
    path, header = folder / "a.nrrd", {"space": "LPS", "space directions": np.eye(3), "space origin": np.zeros(3)}
    if kind == "bzip2 bomb":
        nrrd.write(str(path), np.zeros((4, 4, 4), np.int16), header | {"encoding": "bzip2"})
        head = path.read_bytes().split(b"\n\n", 1)[0]
        path.write_bytes(head + b"\n\n" + bz2.compress(b"\0" * 50_000_000))
    elif kind == "doubles":
        path.write_bytes(
            b"NRRD0004\ntype: double\ndimension: 3\nspace: left-posterior-superior\nsizes: 800 800 800\n"
            b"space directions: (1,0,0) (0,1,0) (0,0,1)\nencoding: gzip\nspace origin: (0,0,0)\n\n"
        )
    elif kind == "wrapped":
        path = write(folder / "a.nii", grid(), affine(0))
        content = bytearray(path.read_bytes())
        content[42:48] = np.array([60000] * 3, "<u2").tobytes()
        path.write_bytes(content)
    elif kind == "text":
        path.write_text("hello\n" * 100)
    elif kind == "empty":
        path.write_bytes(b"")
    return path


def broken(kind: str, folder: Path) -> Path:
    path = folder / ("a.nii" if kind in ("no geometry", "bomb", "film", "flat") else "a.nrrd")
    header = {"space": "LPS", "space directions": np.eye(3), "space origin": np.zeros(3)}
    if kind == "film":
        nibabel.save(nibabel.Nifti1Image(np.zeros((4, 4, 4, 3), np.int16), np.eye(4)), path)
    elif kind == "flat":
        nibabel.save(nibabel.Nifti1Image(np.zeros((4, 4), np.int16), np.eye(4)), path)
    elif kind == "bomb":
        image = nibabel.Nifti1Image(np.zeros((4, 4, 4), np.int16), np.eye(4))
        nibabel.save(image, path)
        content = bytearray(path.read_bytes())
        content[42:48] = np.array([30000, 30000, 30000], "<i2").tobytes()
        path.write_bytes(content)
    elif kind == "no geometry":
        image = nibabel.Nifti1Image(grid(), None)
        image.header["sform_code"] = image.header["qform_code"] = 0
        nibabel.save(image, path)
    elif kind == "no space":
        nrrd.write(str(path), grid(), {})
    elif kind == "scanner":
        nrrd.write(str(path), grid(), header | {"space": "scanner-xyz"})
    elif kind == "packed bomb":
        nrrd.write(str(path), np.zeros((4, 4, 4), np.int16), header | {"encoding": "gzip"})
        head = path.read_bytes().split(b"\n\n", 1)[0]
        path.write_bytes(head + b"\n\n" + gzip.compress(b"\0" * 50_000_000))
    elif kind == "kind":
        path = folder / "a.tif"
        path.write_bytes(b"II*\0")
    return path


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("film", "three axes in a.nii, got 4×4×4×3"),
        ("flat", "three axes in a.nii, got 4×4"),
        ("bomb", "30000×30000×30000"),
        ("no geometry", "sform or a qform"),
        ("no space", "space directions"),
        ("scanner", "scanner-xyz"),
        ("packed bomb", "as its header says, got more"),
        ("kind", "a DICOM folder or a file"),
        ("nothing", "a whole NRRD file"),
    ],
)
def test_what_is_no_scan_is_refused(kind: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ScanError, match=message):
        read_file(broken(kind, tmp_path))


@pytest.mark.parametrize(
    ("kind", "message"),
    [
        ("bzip2 bomb", "as its header says, got more"),
        ("doubles", "2,147,483,648 bytes of values in a.nrrd, got 800×800×800 of 8 bytes"),
        ("wrapped", "32,767 voxels along an axis in a.nii, as NIfTI-1 can count, got 60000×60000×60000"),
        ("text", "one that does not begin with NRRD"),
        ("empty", "a whole NRRD file a.nrrd, got an empty one"),
    ],
)
def test_what_no_program_writes_is_refused(kind: str, message: str, tmp_path: Path) -> None:
    with pytest.raises(ScanError, match=message):
        read_file(broken_by_hand(kind, tmp_path))


def test_axes_so_oblique_that_no_lattice_holds_them(tmp_path: Path) -> None:
    directions = np.array([[1, 0, 0], [0, 1, 0], [20, 0, 1]])
    nrrd.write(
        str(tmp_path / "a.nrrd"),
        grid(shape=(4, 400, 400)),
        {"space": "LPS", "space directions": directions, "space origin": np.zeros(3)},
    )
    with pytest.raises(ScanError, match="voxels once it is upright"):
        read_file(tmp_path / "a.nrrd")


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz", "a.nrrd", "a.mha", "packed.mha", "a.mhd"])
def test_more_values_than_the_header_says(name: str, tmp_path: Path) -> None:
    path = write(tmp_path / name, grid(shape=(24, 20, 40)), affine(0))
    if name == "packed.mha":
        sitk.WriteImage(sitk.ReadImage(str(path)), str(path), useCompression=True)
    content = path.read_bytes()
    if name.endswith(".gz"):
        content = gzip.decompress(content)
    if ".nii" in name:
        content = content[:46] + np.int16(10).tobytes() + content[48:]
    else:
        content = content.replace(b"24 20 40", b"24 20 10")
    path.write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
    with pytest.raises(ScanError, match=r"bytes of values in .*, as its header says, got more"):
        read_file(path)


@pytest.mark.parametrize("name", ["a.mha", "packed.mha", "a.mhd"])
@pytest.mark.parametrize("share", [0.0, 0.02, 0.3, 0.9])
def test_a_meta_image_that_breaks_off_is_told_in_our_words_alone(
    name: str, share: float, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path / name, grid(), affine(0))
    if name == "packed.mha":
        sitk.WriteImage(sitk.ReadImage(str(path)), str(path), useCompression=True)
    cut = path.with_suffix(".raw") if name == "a.mhd" and share else path
    content = cut.read_bytes()
    cut.write_bytes(content[: int(share * len(content))])
    with pytest.raises(ScanError, match=r"MetaImage|bytes of values") as caught:
        read_file(path)
    assert not any(word in str(caught.value) for word in ("SimpleITK", "/", "Exception"))
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (b"DimSize = 24 20 12", b"DimSize = 24 20 no", "without a whole DimSize or ElementType"),
        (b"MET_SHORT", b"MET_OTHER", "without a whole DimSize or ElementType"),
        (b"ElementDataFile = a.raw", b"ElementDataFile = ../a.raw", "in one file beside it, got ../a.raw"),
        (b"ElementDataFile = a.raw", b"ElementDataFile = b.raw", "in one file beside it, got b.raw"),
        (b"DimSize = 24 20 12", b"DimSize = 60000 60000 60000", "got 60000×60000×60000"),
    ],
)
def test_a_meta_image_whose_header_will_not_do(old: bytes, new: bytes, message: str, tmp_path: Path) -> None:
    path = write(tmp_path / "a.mhd", grid(), affine(0))
    assert old in path.read_bytes()
    path.write_bytes(path.read_bytes().replace(old, new))
    with pytest.raises(ScanError, match=message):
        read_file(path)


@pytest.mark.parametrize("name", ["a.nii", "a.nii.gz", "a.nrrd", "a.mha", "a.mhd"])
@given(seed=st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_a_damaged_header_is_read_or_refused_and_nothing_else(
    name: str, seed: int, tmp_path_factory: pytest.TempPathFactory, capfd: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path_factory.mktemp("s") / name, grid(), affine(0))
    content, rng = bytearray(path.read_bytes()), np.random.default_rng(seed)
    for _ in range(rng.integers(1, 4)):
        at = int(rng.integers(min(len(content) - 8, 400)))
        kept = int(rng.integers(0, 3))
        content[at : at + kept] = rng.integers(256, size=int(rng.integers(0, 3)), dtype=np.uint8).tobytes()
    path.write_bytes(content)
    with contextlib.suppress(ScanError):
        read_file(path)
    assert capfd.readouterr() == ("", "")
