"""What packed data may grow to, and that deflated DICOM files are read as those that are not."""

from __future__ import annotations

import bz2
import gzip
import io
import zlib
from pathlib import Path

import numpy as np
import pytest
from pydicom.uid import DeflatedExplicitVRLittleEndian

from naris.ct.dicom import read_dicom
from naris.ct.packed import check_payload, pieces
from naris.errors import ScanError
from tests.ct.dicom_files import affine, grid, images, write

PACKERS = {
    "gzip": gzip.compress,
    "zlib": zlib.compress,
    "bzip2": bz2.compress,
    "deflate": lambda data: zlib.compress(data)[2:-4],
}


@pytest.mark.parametrize("kind", PACKERS)
def test_pieces_are_the_whole_and_small(kind: str) -> None:
    data = np.random.default_rng(0).integers(0, 4, 5_000_000, dtype=np.uint8).tobytes()
    found = list(pieces(io.BytesIO(PACKERS[kind](data) + b"what follows"), kind))
    assert b"".join(found) == data
    assert max(map(len, found)) <= 2**20
    with pytest.raises(EOFError):
        list(pieces(io.BytesIO(PACKERS[kind](data)[:-20]), kind))


def test_gzip_in_several_parts() -> None:
    assert b"".join(pieces(io.BytesIO(gzip.compress(b"ab") + gzip.compress(b"cd")), "gzip")) == b"abcd"


@pytest.mark.parametrize("kind", [None, *PACKERS])
def test_a_payload_is_as_long_as_the_header_says(kind: str | None, tmp_path: Path) -> None:
    path, pack = tmp_path / "a", PACKERS[kind] if kind else bytes
    path.write_bytes(b"head" + pack(b"x" * 20_000))
    check_payload(path, 4, 20_000, kind)
    with pytest.raises(ScanError, match="30,000 bytes of values in a, as its header says, got 20,000; copy it anew"):
        check_payload(path, 4, 30_000, kind)
    with pytest.raises(ScanError, match="10,000 bytes of values in a, as its header says, got more"):
        check_payload(path, 4, 10_000, kind)


def test_a_deflated_series_is_the_one_that_was_not(tmp_path: Path) -> None:
    hu, matrix = grid(), affine()
    datasets = images(hu, matrix)
    for dataset in datasets:
        dataset.file_meta.TransferSyntaxUID = DeflatedExplicitVRLittleEndian
    scan = read_dicom(write(tmp_path, datasets))
    np.testing.assert_array_equal(scan.volume.hu, hu)
    broken = min(path for path in tmp_path.rglob("*") if path.is_file())
    broken.write_bytes(broken.read_bytes()[:-200])
    with pytest.raises(ScanError, match=broken.name):
        read_dicom(tmp_path)


def test_a_deflated_file_that_grows_is_refused_before_it_does(tmp_path: Path) -> None:
    datasets = images(grid(), affine())
    datasets[3].file_meta.TransferSyntaxUID = DeflatedExplicitVRLittleEndian
    datasets[3].PixelData = b"\0" * 100_000_000
    with pytest.raises(ScanError, match="as its header says, got more once it is unpacked"):
        read_dicom(write(tmp_path, datasets))
