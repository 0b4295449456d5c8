"""Values that no CT has are refused, values that are off are told, and real and simulated scans raise no alarm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from naris.core.volume import Volume
from naris.ct.files import read_file
from naris.ct.scan import Scan
from naris.ct.values import below_skin_hu, check_values
from naris.errors import ScanError
from tests.ct.dicom_files import grid
from tests.ct.test_read import REAL

AIR, FAT, BRAIN, BONE = 0, 1, 2, 3


def scan(values: np.ndarray) -> Scan:
    limits = np.iinfo(np.int16)
    return Scan(Volume(np.rint(np.clip(values, limits.min, limits.max)).astype(np.int16), np.eye(4)), "NRRD", 1.0)


def phantom(air: float, fat: float, brain: float, bone: float, noise: float = 20.0) -> np.ndarray:
    """A ball of a brain in a skull in 8 mm of fat, with those values, with a cavity in the middle."""
    index = np.stack(np.meshgrid(*[np.arange(72)] * 3, indexing="ij"), axis=-1)
    radius = np.linalg.norm(index - 35.5, axis=-1)
    values = np.select([radius < 6, radius < 20, radius < 24, radius < 32], [air, brain, bone, fat], air)
    return values + np.random.default_rng(0).normal(0, noise, values.shape)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (np.full((8, 8, 8), 37), "37 HU throughout"),
        (grid(shape=(16, 16, 16)).astype(int) + 1024, "rescale intercept were lost"),
        (np.random.default_rng(0).integers(0, 900, (16, 16, 16)), "rescale intercept were lost"),
        (np.random.default_rng(0).integers(-2000, -1500, (16, 16, 16)), "values -2000 to -1501"),
    ],
)
def test_values_that_no_ct_has(values: np.ndarray, message: str) -> None:
    with pytest.raises(ScanError, match=message):
        check_values(scan(values))


@pytest.mark.parametrize(
    ("shift_hu", "told"),
    [
        (
            1024,
            "air at about 24 HU and soft tissue at about 1074; the .* seems to be lost: subtract 1024",
        ),
        (-1024, "air at about −2024 HU and soft tissue at about −974; the .* seems to be applied twice: add 1024"),
    ],
    ids=["lost", "twice"],
)
@pytest.mark.parametrize("path", REAL, ids=lambda path: path.name)
def test_a_rescale_intercept_that_is_lost_or_applied_twice_is_named(path: Path, shift_hu: int, told: str) -> None:
    if not path.is_file():
        pytest.skip(f"{path.name} of the shared data is not here")
    with pytest.raises(ScanError, match=told):
        check_values(scan(read_file(path).volume.hu.astype(int) + shift_hu))


@pytest.mark.parametrize("beyond_hu", [-1500, -2000, -2048, -3024])
def test_what_scanners_write_beyond_the_picture_is_no_lost_intercept(beyond_hu: int) -> None:
    values = phantom(-1000, -90, 40, 900)
    index = np.arange(72) - 35.5
    values[index[:, None] ** 2 + index**2 > 34**2] = beyond_hu
    check_values(scan(values))


@pytest.mark.parametrize("path", REAL, ids=lambda path: path.name)
@pytest.mark.parametrize("noise_hu", [0, 60, 150])
def test_real_scans_are_cts(path: Path, noise_hu: float) -> None:
    if not path.is_file():
        pytest.skip(f"{path.name} of the shared data is not here")
    volume = read_file(path).volume
    noise = np.random.default_rng(0).normal(0, noise_hu, volume.hu.shape) if noise_hu else 0
    hu = np.rint(volume.hu + noise).astype(np.int16)
    assert check_values(Scan(Volume(hu, volume.frame_T_index), "NRRD", 1.0)) == ()


def test_a_ct_of_the_phantom_passes_whatever_its_noise() -> None:
    for noise in (0, 15, 30):
        assert check_values(scan(phantom(-1000, -90, 40, 900, noise))) == ()


def test_an_mr_of_the_phantom_is_refused() -> None:
    with pytest.raises(ScanError, match="hardly any value is as low as air, as in an MR"):
        check_values(scan(phantom(0, 900, 450, 20)))


@pytest.mark.parametrize(
    ("values", "code"),
    [
        ((-1000, 100, 40, -950), "no bone"),
        ((-1000, 700, 40, -950), "bright skin"),
        ((-1000, 0, 0, 0), "no bone"),
    ],
    ids=["signed MR", "signed MR with bright fat", "water"],
)
def test_what_may_be_no_ct_is_told(values: tuple[float, float, float, float], code: str) -> None:
    findings = {finding.code: finding for finding in check_values(scan(phantom(*values)))}
    assert findings[code].weight == "warning" and "MR" in findings[code].text


@pytest.mark.parametrize(("slope", "offset"), [(1.0, 180.0), (0.85, 150.0), (1.15, -180.0)])
def test_a_cone_beam_ct_that_is_off_is_told_and_not_refused(slope: float, offset: float) -> None:
    (finding,) = check_values(scan(slope * phantom(-1000, -90, 40, 900, 60) + offset))
    assert (finding.code, finding.weight) == ("hounsfield", "warning")
    assert "cone-beam" in finding.text


def test_below_the_skin_is_found_from_every_side_and_not_where_the_head_is_cut() -> None:
    volume = scan(phantom(-1000, -90, 40, 900, 0)).volume
    assert below_skin_hu(volume) == pytest.approx(-90, abs=1)
    middle = Volume(volume.hu[20:50, 20:50, 20:50].copy(), np.eye(4))
    assert below_skin_hu(middle) is None


@pytest.mark.parametrize("size_mm", [1e-20, 0.001, 400.0])
def test_voxels_of_no_size_that_scanners_make(size_mm: float) -> None:
    hu = scan(phantom(-1000, -90, 40, 900)).volume.hu
    with pytest.raises(ScanError, match=r"voxels of 0.02 to 30 mm, got 1×1×"):
        check_values(Scan(Volume(hu, np.diag([1, 1, size_mm, 1])), "NRRD", 1.0))


@pytest.mark.parametrize(("factor", "unit"), [(0.001, "metres"), (1000.0, "micrometres")])
def test_voxels_in_another_unit_are_told_so(factor: float, unit: str) -> None:
    hu = scan(phantom(-1000, -90, 40, 900)).volume.hu
    with pytest.raises(ScanError, match=rf"are the spacings in {unit}\?"):
        check_values(Scan(Volume(hu, np.diag([2 * factor, 2 * factor, 2 * factor, 1])), "NRRD", 1.0))
