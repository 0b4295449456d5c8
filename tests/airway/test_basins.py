"""Air is cut at its narrow places, and a cavity behind an ostium is told from a slit."""

from __future__ import annotations

import numpy as np
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
    basins = basins_of(air, room)
    x = grid()[0]
    slit, ball = basins.part[16, 30, 30], basins.part[61, 30, 30]
    assert slit != ball
    nasal = nasal_parts(basins, np.array([slit]))[basins.part]
    assert nasal[air & (x < -12)].all()
    assert not nasal[air & (x > 3)].any()


def test_a_wide_entrance_makes_it_one() -> None:
    air = two_rooms(neck_mm=5.5)
    basins = basins_of(air, wall_mm(air, STEP_MM))
    nasal = nasal_parts(basins, np.array([basins.part[16, 30, 30]]))[basins.part]
    assert nasal[air].mean() > 0.99


@settings(deadline=None, max_examples=15)
@given(st.integers(0, 2**31))
def test_parts_cover_the_air_and_necks_are_narrower_than_rooms(seed: int) -> None:
    air = gaussian_filter(np.random.default_rng(seed).standard_normal((24, 24, 24)), 2.0) > 0
    room = wall_mm(air, STEP_MM)
    basins = basins_of(air, room)
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
