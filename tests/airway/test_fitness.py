"""What a first look at a scan notices: where it ends, metal, an open mouth, slices that are too far apart."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from naris.airway.fitness import METAL_HU, Fitness, inspect_scan, look_at
from naris.core.volume import Volume
from naris.ct.scan import Scan
from tests import simulated_head


def codes(found: Fitness) -> set[str]:
    return {one.code for one in found.findings}


@pytest.fixture(scope="module")
def scan() -> Scan:
    return Scan(simulated_head.scan(), "NRRD", 1.0)


@pytest.mark.slow
def test_a_whole_nose_without_metal_will_do(scan: Scan) -> None:
    found = inspect_scan(scan)
    assert found.usable
    assert found.step_mm == 0.8
    assert found.metal_ml == found.mouth_ml == 0
    assert not codes(found) & {"metal", "open mouth", "coarse slices", "ends behind", "ends below"}


def test_a_scan_that_ends_above_the_nostrils_is_told_and_will_not_do(scan: Scan) -> None:
    """Cut so that the nostrils are gone: no way leads in, and the reason stands beside it."""
    volume = scan.volume
    first = int(np.ceil(volume.index(simulated_head.nose().landmarks_mm["left.nostril"] + [0, 0, 12.0])[2]))
    matrix = volume.frame_T_index.copy()
    matrix[:3, 3] = volume.points_mm(np.array([0.0, 0, first]))
    found = inspect_scan(replace(scan, volume=Volume(volume.hu[:, :, first:], matrix)))
    assert not found.usable
    assert "ends below" in codes(found)
    assert found.volume_ml == {}


def test_metal_in_the_nose_is_a_warning(scan: Scan) -> None:
    hu = scan.volume.hu.copy()
    at = np.rint(scan.volume.index(simulated_head.nose().landmarks_mm["left.middle meatus"])).astype(int)
    hu[at[0] - 4 : at[0] + 4, at[1] - 4 : at[1] + 4, at[2] - 2 : at[2] + 2] = METAL_HU
    found = inspect_scan(replace(scan, volume=replace(scan.volume, hu=hu)))
    metal = next(one for one in found.findings if one.code == "metal")
    assert metal.weight == "warning"
    assert found.metal_ml == pytest.approx(8 * 8 * 4 * 0.25 / 1000, rel=0.01)


def test_a_real_head_with_an_open_mouth_fillings_and_coarse_slices(shared_data) -> None:
    found = simulated_head.looked_at(shared_data / "ct-head/ct_head.nii.gz")
    assert found.usable
    assert {"open mouth", "metal", "coarse slices"} <= codes(found)
    assert found.mouth_ml > 2


def test_a_real_sinus_scan_with_a_closed_mouth(shared_data) -> None:
    found = simulated_head.looked_at(shared_data / "nasalseg-p001/P001_img.nrrd")
    assert found.usable
    assert not codes(found) & {"coarse slices", "open mouth"}
    assert found.reach_mm["behind"] > 70


def test_pixels_that_are_not_square_are_told(scan: Scan) -> None:
    """One axis of the slices halved in the header, as a field of the spacing that was mistyped."""
    matrix = np.diag([0.6, 1.0, 1.0, 1.0]) @ scan.volume.frame_T_index
    matrix[:3, 2] *= 1.5
    assert "pixels" in {one.code for one in look_at(replace(scan, volume=Volume(scan.volume.hu, matrix))).findings}
    assert "pixels" not in {one.code for one in look_at(scan).findings}
