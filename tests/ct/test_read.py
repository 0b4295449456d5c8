"""Scans by their path: real ones are read as SimpleITK reads them, and what is no CT is refused."""

from __future__ import annotations

import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest
import SimpleITK as sitk

from naris.ct.read import read_scan
from naris.errors import OutOfMemory, ScanError
from tests.ct.dicom_files import affine, grid, images, write

SHARED = Path(__file__).parents[3] / "shared" / "data"
REAL = [SHARED / "nasalseg-p001" / "P001_img.nrrd", SHARED / "ct-head" / "ct_head.nii.gz"]


@pytest.mark.parametrize("path", REAL, ids=lambda path: path.name)
def test_real_scans_lie_where_another_library_puts_them(path: Path) -> None:
    if not path.is_file():
        pytest.skip(f"{path.name} of the shared data is not here")
    scan = read_scan(path)
    theirs = sitk.ReadImage(str(path))
    assert scan.volume.shape == theirs.GetSize()
    corner = tuple(n - 1 for n in scan.volume.shape)
    for index in ((0, 0, 0), corner, tuple(n // 2 for n in scan.volume.shape)):
        place = theirs.TransformIndexToPhysicalPoint([int(n) for n in index])
        np.testing.assert_allclose(scan.volume.points_mm(np.array(index)), place, atol=1e-3)
        assert scan.volume.hu[index] == pytest.approx(theirs[[int(n) for n in index]], abs=0.5)


def test_a_dicom_folder_and_one_of_its_files(tmp_path: Path) -> None:
    hu = grid()
    hu[:8] = -1000
    hu[8:16] = 40
    write(tmp_path, images(hu, affine()))
    assert read_scan(tmp_path).format == "DICOM"
    one = next(path for path in tmp_path.rglob("*") if path.is_file())
    with pytest.raises(ScanError, match="a CT series of 3 images"):
        read_scan(one)


def test_nothing_there(tmp_path: Path) -> None:
    with pytest.raises(ScanError, match="nothing there"):
        read_scan(tmp_path / "absent.nrrd")
    (tmp_path / "a.nrrd").write_bytes(b"NRRD0004\n")
    with pytest.raises(ScanError, match="leave --series out"):
        read_scan(tmp_path / "a.nrrd", series="4")


LITTLE_MEMORY = """
import resource, sys
from naris.ct.read import read_scan
from naris.errors import OutOfMemory
pages = int(open("/proc/self/statm").read().split()[0])
most = pages * resource.getpagesize() + 60_000_000
resource.setrlimit(resource.RLIMIT_AS, (most, most))
try:
    read_scan(sys.argv[1])
except OutOfMemory as error:
    print(error)
"""


@pytest.mark.skipif(not Path("/proc/self/statm").is_file(), reason="how much memory is in use is told on Linux alone")
@pytest.mark.parametrize("name", ["a.nii.gz", "a.nii", "a.nrrd", "a.mha"])
def test_too_little_memory_is_one_sentence(name: str, tmp_path: Path) -> None:
    path = tmp_path / name
    image = sitk.Image(512, 512, 128, sitk.sitkFloat32)
    sitk.WriteImage(image, str(path), useCompression=name != "a.nii")
    done = subprocess.run(
        [sys.executable, "-c", LITTLE_MEMORY, str(path)], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.stdout.startswith(f"expected memory enough to read {name}, got "), done.stderr
    assert done.stdout.endswith("; crop the scan, end other programs or take a larger machine\n")


def test_libraries_are_silent(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    hu = grid()
    hu[:8] = -1000
    hu[8:16] = 40
    datasets = images(hu, affine())
    for dataset in datasets:
        dataset.PixelData += b"\0" * 64
    write(tmp_path, datasets)
    path = min(file for file in tmp_path.rglob("*") if file.is_file())
    path.write_bytes(path.read_bytes().replace(b"ORIGINAL", b"original"))
    with warnings.catch_warnings(record=True) as told:
        warnings.simplefilter("always")
        read_scan(tmp_path)
    assert told == []
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("Unable to allocate 512. MiB for an array with shape (2, 2)", "got none for another 512 MiB;"),
        ("Unable to allocate 7.45 GiB for an array", "got none for another 7.45 GiB;"),
        ("", "got too little;"),
    ],
)
def test_how_much_memory_was_asked_for(said: str, told: str) -> None:
    assert told in str(OutOfMemory.of("to read a.nrrd", MemoryError(said)))
