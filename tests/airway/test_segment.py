"""The airway is found where it is: in simulated scans whose truth is known, and in real ones with expert labels."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from naris.airway.block import BEYOND_HU, block_of
from naris.airway.face import nose_tip_mm
from naris.airway.segment import ATTACHED, LEFT, NASOPHARYNX, RIGHT, SEGMENTS, Airway, segment_airway
from naris.anatomy.builtin import built_in_nose
from naris.anatomy.builtin.variation import drawn_parameters
from naris.anatomy.distance import signed_distance
from naris.anatomy.virtual_ct import Scanner, virtual_ct
from naris.core.anatomy import Anatomy
from naris.core.volume import Volume
from naris.ct.read import read_scan
from naris.ct.resample import sampled
from naris.errors import ScanError
from tests import simulated_head
from tests.ct.dicom_files import affine, grid

COARSE_MM = 0.8
SINUSES_ML = {"maxillary sinus": (8, 35), "ethmoid cells": (1, 9), "frontal sinus": (1, 12), "sphenoid sinus": (4, 16)}
"""Of an adult, generously."""


@pytest.fixture
def nose() -> Anatomy:
    return simulated_head.nose()


@pytest.fixture
def scan() -> Volume:
    return simulated_head.scan()


@pytest.fixture
def airway() -> Airway:
    return simulated_head.airway()


@pytest.fixture
def coarse() -> Airway:
    return simulated_head.coarse_airway()


def dice(one: np.ndarray, other: np.ndarray) -> float:
    return 2 * float((one & other).sum()) / float(one.sum() + other.sum())


def lumen(anatomy: Anatomy, airway: Airway) -> np.ndarray:
    """Which nodes of the segmentation lie in the anatomy's lumen."""
    distance = signed_distance(anatomy)
    nx, ny, nz = airway.labels.shape
    j, k = np.meshgrid(np.arange(ny), np.arange(nz), indexing="ij")
    return np.stack([distance(airway.block.points_mm(np.stack([np.full_like(j, i), j, k], -1))) > 0 for i in range(nx)])


def test_the_lumen_of_a_simulated_head_is_found(nose: Anatomy, airway: Airway) -> None:
    truth = lumen(nose, airway)
    inner = np.broadcast_to(airway.block.axis_mm(2) > -22, truth.shape)  # below lie the nostrils, open to the room
    found = np.isin(airway.labels, (RIGHT, LEFT, NASOPHARYNX))
    assert dice(found & inner, truth & inner) > 0.95


def test_left_is_left_and_right_is_right(nose: Anatomy, airway: Airway) -> None:
    for side, label in (("left", LEFT), ("right", RIGHT)):
        for place in ("valve", "inferior meatus", "middle meatus", "common meatus"):
            at = airway.block.index(nose.landmarks_mm[f"{side}.{place}"])
            assert airway.labels[tuple(at)] == label, f"{side} {place}"
    assert airway.labels[tuple(airway.block.index(nose.landmarks_mm["nasopharynx"]))] == NASOPHARYNX


def test_landmarks_lie_where_they_were_made(nose: Anatomy, airway: Airway) -> None:
    for name in ("left.nostril", "right.nostril", "left.choana", "right.choana"):
        off = np.linalg.norm(airway.landmarks_mm[name] - nose.landmarks_mm[name])
        assert off < 4.5, name
    assert np.linalg.norm(airway.landmarks_mm["anterior tip"][1] - nose.bounds_mm[0, 1]) < 3


def test_a_stored_order_of_voxels_changes_nothing(scan: Volume, coarse: Airway) -> None:
    """The same scan with its axes permuted and reversed, and its matrix with them."""
    matrix = scan.frame_T_index.copy()
    matrix[:3, 3] += matrix[:3, 0] * (scan.shape[0] - 1)
    matrix[:3, 0] *= -1
    turned = Volume(np.ascontiguousarray(scan.hu[::-1].transpose(2, 0, 1)), matrix[:, [2, 0, 1, 3]])
    assert (segment_airway(turned, COARSE_MM).labels != coarse.labels).mean() < 1e-4


def test_a_mirrored_head_has_its_sides_changed(scan: Volume, coarse: Airway) -> None:
    mirror = np.diag([-1.0, 1, 1, 1])
    matrix = mirror @ scan.frame_T_index
    mirrored = segment_airway(Volume(scan.hu, matrix), COARSE_MM)
    for one, other in ((LEFT, RIGHT), (RIGHT, LEFT), (NASOPHARYNX, NASOPHARYNX)):
        assert mirrored.volume_ml(one) == pytest.approx(coarse.volume_ml(other), rel=0.03)


@pytest.mark.parametrize(("axis", "degrees"), [(0, 12.0), (0, -12.0), (2, 8.0), (1, 10.0)])
def test_a_scan_at_an_angle_holds_the_same_nose(scan: Volume, airway: Airway, axis: int, degrees: float) -> None:
    """The same head, turned with its scan: nothing beyond the scan's corners is taken for the head or the room."""
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("xyz"[axis], degrees, degrees=True).as_matrix()
    turned = segment_airway(Volume(scan.hu, turn @ scan.frame_T_index), COARSE_MM)
    for label in (LEFT, RIGHT):
        assert turned.volume_ml(label) == pytest.approx(airway.volume_ml(label), rel=0.1)
    for name in ("left.nostril", "right.choana"):
        back = np.linalg.inv(turn)[:3, :3] @ turned.landmarks_mm[name]
        assert np.linalg.norm(back - airway.landmarks_mm[name]) < 4, name


@pytest.mark.long
@pytest.mark.parametrize("number", [10, 19])
def test_a_cleft_behind_narrow_slits_is_kept(number: int) -> None:
    """Two drawn noses whose right olfactory cleft was once taken for ethmoid cells."""
    nose = built_in_nose(drawn_parameters(np.random.default_rng([0, number])), passages=False)
    found = segment_airway(virtual_ct(nose, Scanner(), number))
    distance = signed_distance(nose, 1.0)
    places = distance.origin_mm + distance.spacing_mm * np.argwhere(distance.values_mm > 1)
    regions = nose.region_set("anatomical")
    cleft = regions.label(places) == regions.names.index("right superior meatus and olfactory cleft")
    nodes = np.rint((places[cleft] - found.block.origin_mm) / found.block.step_mm).astype(int)
    assert (found.labels[tuple(nodes.T)] == RIGHT).mean() > 0.9


def test_thick_coronal_slices_at_an_angle(nose: Anatomy, airway: Airway) -> None:
    """Slices from front to back, 3 mm apart and 20° off: what lies in front is told in mm, not in voxels."""
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_euler("x", 20, degrees=True).as_matrix()
    axes = turn[:3, :3] @ np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]]).T
    scan = simulated_head.scan()
    low, high = scan.bounds_mm
    corners = np.stack(np.meshgrid(*zip(low, high, strict=True), indexing="ij"), -1).reshape(-1, 3) @ axes
    spacing = np.array([0.5, 0.5, 3.0])
    shape = np.ceil(np.ptp(corners, axis=0) / spacing).astype(int) + 1
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = axes * spacing, axes @ corners.min(axis=0)
    index = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), -1)
    points = np.clip(index @ matrix[:3, :3].T + matrix[:3, 3], low, high)
    hu = sampled(scan, points).astype(np.int16)
    found = segment_airway(Volume(hu, matrix), COARSE_MM)
    for label in (LEFT, RIGHT):
        assert found.volume_ml(label) == pytest.approx(airway.volume_ml(label), rel=0.15)


@pytest.mark.slow
def test_a_real_head_with_an_open_mouth_and_metal(shared_data) -> None:
    airway = segment_airway(read_scan(shared_data / "ct-head/ct_head.nii.gz").volume, COARSE_MM)
    for side in (RIGHT, LEFT):
        assert 6 < airway.volume_ml(side) < 20
    assert 4 < airway.volume_ml(NASOPHARYNX) < 20
    ml = {name: airway.volume_ml(1 + number) for number, name in enumerate(SEGMENTS)}
    for name, (least, most) in SINUSES_ML.items():
        sides = (name,) if name in ml else (f"right {name}", f"left {name}")
        assert all(least < ml[side] < most for side in sides), ml
    assert ml["other attached cavities"] > 5  # the mouth
    marks = airway.landmarks_mm
    mouth = marks["anterior tip"] + [0, 50, -26]
    assert airway.labels[tuple(airway.block.index(mouth))] in (0, ATTACHED)
    assert marks["left.choana"][1] - marks["anterior tip"][1] > 60
    assert marks["left.nostril"][0] > marks["right.nostril"][0]


def test_a_blocked_nostril_is_told(nose: Anatomy, scan: Volume) -> None:
    hu = scan.hu.copy()
    places = np.stack(np.meshgrid(*[np.arange(n) for n in scan.shape], indexing="ij"), -1)
    off = scan.points_mm(places) - nose.landmarks_mm["left.nostril"]
    hu[(np.abs(off[..., 0]) < 7) & (np.abs(off[..., 1]) < 14) & (np.abs(off[..., 2] - 2) < 7)] = 40
    with pytest.raises(ScanError, match="two open nostrils"):
        segment_airway(replace(scan, hu=hu), COARSE_MM)


def test_a_head_without_a_room_in_front_is_refused() -> None:
    with pytest.raises(ScanError, match="air in front of the face"):
        nose_tip_mm(Volume(np.full((40, 40, 40), 40, np.int16), np.diag([2.0, 2.0, 2.0, 1.0])))
    with pytest.raises(ScanError, match="a head with air"):
        segment_airway(Volume(np.full((40, 40, 40), -1000, np.int16), np.diag([2.0, 2.0, 2.0, 1.0])))
    with pytest.raises(ScanError, match="in LPS"):
        segment_airway(Volume(grid(), affine(), "RAS"))


def test_a_ball_has_no_nostrils() -> None:
    x, y, z = np.meshgrid(*[np.arange(-40, 41, dtype=float)] * 3, indexing="ij")
    hu = np.where(x**2 + y**2 + z**2 < 35**2, 40, -1000).astype(np.int16)
    hu[x**2 + y**2 + z**2 < 10**2] = -1000
    matrix = np.diag([2.0, 2.0, 2.0, 1.0])
    with pytest.raises(ScanError, match="two open nostrils"):
        segment_airway(Volume(hu, matrix), COARSE_MM)


def test_a_block_has_the_scan_s_values_where_they_are() -> None:
    volume = Volume(grid(), affine(np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])))
    block = block_of(volume, 0.5)
    for index in ([3, 4, 5], [10, 12, 7]):
        near = np.rint((volume.points_mm(np.array(index)) - block.origin_mm) / block.step_mm).astype(int)
        at = volume.index(block.points_mm(near))
        low = np.floor(at).astype(int)
        part = at - low
        expected = 0.0
        for corner in np.ndindex(2, 2, 2):
            weight = np.prod(np.where(corner, part, 1 - part))
            expected += weight * volume.hu[tuple(low + corner)]
        assert block.hu[tuple(near)] == pytest.approx(expected, abs=0.5)
    beyond = block_of(volume, 0.5, volume.bounds_mm[0] - 50, volume.bounds_mm[1] + 50)
    assert np.allclose(beyond.origin_mm, volume.bounds_mm[0])
    assert BEYOND_HU > -400
