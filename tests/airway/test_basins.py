"""Air is cut at its narrow places, and a cavity behind an ostium is told from a slit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import gaussian_filter

from naris.airway.basins import basins_of, nasal_parts, wall_mm

STEP_MM = 0.5


def grid(shape: tuple[int, int, int] = (90, 60, 60)) -> np.ndarray:
    """Coordinates in mm from the middle, (3, nx, ny, nz)."""
    axes = [STEP_MM * (np.arange(n) - (n - 1) / 2) for n in shape]
    return np.stack(np.meshgrid(*axes, indexing="ij"))


def two_rooms(neck_mm: float, room_mm: float = 7.0) -> np.ndarray:
    """A slit of 2 mm half-width with a ball beside it; they meet in a tube of that radius."""
    x, y, z = grid()
    slit = (np.abs(x + 14) < 2) & (np.abs(y) < 12) & (np.abs(z) < 12)
    ball = (x - 8) ** 2 + y**2 + z**2 < room_mm**2
    tube = (y**2 + z**2 < neck_mm**2) & (x > -14) & (x < 8)
    return slit | ball | tube


def test_a_cavity_behind_an_ostium_is_left_out() -> None:
    air = two_rooms(neck_mm=1.5)
    room = wall_mm(air, STEP_MM)
    basins = basins_of(air, room, STEP_MM)
    x = grid()[0]
    slit, ball = basins.part[16, 30, 30], basins.part[61, 30, 30]
    assert slit != ball
    nasal = nasal_parts(basins, np.array([slit]))[basins.part]
    assert nasal[air & (x < -12)].all()
    assert not nasal[air & (x > 3)].any()


def test_a_wide_entrance_makes_it_one() -> None:
    air = two_rooms(neck_mm=5.5)
    basins = basins_of(air, wall_mm(air, STEP_MM), STEP_MM)
    nasal = nasal_parts(basins, np.array([basins.part[16, 30, 30]]))[basins.part]
    assert nasal[air].mean() > 0.99


def beside_a_slit(opening_mm: float) -> np.ndarray:
    """A slit with a cavity of 3.2 mm half-width beside it, open to it over that length through a gap of 2.6 mm."""
    x, y, z = grid()
    slit = (np.abs(x + 14) < 2) & (np.abs(y) < 12) & (np.abs(z) < 12)
    cavity = (np.abs(x) < 5) & (np.abs(y) < 12) & (np.abs(z) < 3.2)
    gap = (x > -14) & (x < 0) & (np.abs(z) < 1.3) & (np.abs(y) < opening_mm / 2)
    return slit | cavity | gap


@pytest.mark.parametrize(("opening_mm", "is_nasal"), [(22.0, True), (3.0, False)])
def test_a_cavity_open_over_a_large_area_is_nasal_but_not_where_sinuses_are(opening_mm: float, is_nasal: bool) -> None:
    air = beside_a_slit(opening_mm)
    basins = basins_of(air, wall_mm(air, STEP_MM), STEP_MM)
    way, cavity = (np.array([basins.part[i, 30, 30]]) for i in (16, 45))
    nowhere = np.zeros(len(basins.room_mm), bool)
    inside = grid()[0] > -3
    assert not nasal_parts(basins, way)[cavity].any()
    assert nasal_parts(basins, way, nowhere)[basins.part][air & inside].mean() == float(is_nasal)
    assert not nasal_parts(basins, way, ~nowhere)[cavity].any()


def test_areas_count_the_faces_between_parts() -> None:
    air = two_rooms(neck_mm=1.5)
    basins = basins_of(air, wall_mm(air, STEP_MM), STEP_MM)
    assert basins.size.sum() == air.size
    assert basins.area_mm2.max() == pytest.approx(np.pi * 1.5**2, rel=0.4)


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 2**31))
def test_parts_cover_the_air_and_necks_are_narrower_than_rooms(seed: int) -> None:
    air = gaussian_filter(np.random.default_rng(seed).standard_normal((24, 24, 24)), 2.0) > 0
    room = wall_mm(air, STEP_MM)
    basins = basins_of(air, room, STEP_MM)
    assert np.array_equal(basins.part > 0, air)
    assert (basins.neck_mm <= basins.room_mm[basins.pairs].min(axis=1) + 1e-6).all()
    assert (basins.pairs[:, 0] < basins.pairs[:, 1]).all()
    everything = nasal_parts(basins, np.arange(1, len(basins.room_mm)))
    assert everything[1:].all()
    assert not everything[0]


def test_the_distance_to_the_wall_is_that_of_a_ball() -> None:
    points = grid((60, 60, 60))
    radius = np.linalg.norm(points, axis=0)
    room = wall_mm(radius < 10, STEP_MM)
    off = room[radius < 9] - (10 - radius[radius < 9])
    assert np.abs(off).max() < 1.2 * STEP_MM
