"""A scan may begin in front of the nose, with a warning in its tip, and not in the nasal cavity."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from naris.airway.fitness import inspect_scan
from naris.airway.segment import Airway, segment_airway
from naris.core.volume import Volume
from naris.ct.read import read_scan
from naris.ct.scan import Scan
from naris.errors import ScanError
from tests import simulated_head
from tests.airway.test_plausible import cropped

COARSE_MM = 0.8
CUT = "one whose front cuts through the nasal cavity"


def begun(volume: Volume, further_mm: float) -> Volume:
    """The scan without its first millimetres from in front."""
    first_mm = float(volume.bounds_mm[0, 1]) + further_mm
    return cropped(volume, (-np.inf, first_mm, -np.inf), (np.inf, np.inf, np.inf))


def warned(volume: Volume) -> bool:
    return told(segment_airway(volume, COARSE_MM))


def told(airway: Airway) -> bool:
    return "clipped nose" in {one.code for one in airway.findings}


def test_a_scan_that_begins_in_front_of_the_nose_is_whole() -> None:
    assert not told(simulated_head.coarse_airway())
    assert not warned(begun(simulated_head.scan(), 8.0))


def test_a_scan_that_begins_in_the_tip_is_told() -> None:
    assert warned(begun(simulated_head.scan(), 13.0))


@pytest.mark.parametrize("degrees", [0.0, -10.0, 10.0])
def test_a_scan_at_an_angle_that_begins_in_the_cavity_is_refused(degrees: float) -> None:
    cut = begun(simulated_head.scan(), 22.0)
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("x", degrees, degrees=True).as_matrix()
    with pytest.raises(ScanError, match=CUT):
        segment_airway(Volume(cut.hu, turn @ cut.frame_T_index), COARSE_MM)


@pytest.mark.parametrize("slices", [8, 14, 20, 28, 40])
def test_a_real_scan_without_its_front_is_refused(shared_data: Path, slices: int) -> None:
    scan = read_scan(shared_data / "nasalseg-p001/P001_img.nrrd")
    cut = begun(scan.volume, slices * float(scan.volume.spacing_mm[1]))
    found = inspect_scan(Scan(cut, scan.format, scan.slice_mm))
    assert not found.usable
    assert CUT in str(found.reason)
    assert found.reach_mm["before"] <= 2


def test_real_scans_as_they_are_will_do(shared_data: Path) -> None:
    """One that begins in the tip of the nose, and one with the room in front of it."""
    clipped, whole = (
        simulated_head.looked_at(shared_data / name)
        for name in ("nasalseg-p001/P001_img.nrrd", "ct-head/ct_head.nii.gz")
    )
    assert clipped.usable and whole.usable
    assert "clipped nose" in {one.code for one in clipped.findings}
    assert "clipped nose" not in {one.code for one in whole.findings}
    assert whole.reach_mm["before"] > 5
