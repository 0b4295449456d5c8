"""The boundary between air and tissue, where it is known: walls and slits blurred as a scanner blurs them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.special import erf

from naris.airway.block import Block
from naris.airway.boundary import air_level

STEP_MM, BLUR_MM = 0.5, 0.5


def slab(width_mm: float, shift_mm: float, noise_hu: float = 0.0) -> Block:
    """A slab of air across x between walls of tissue, exactly blurred, on a lattice that the slab does not fit."""
    x = STEP_MM * (np.arange(60) - 29.5) - shift_mm
    air = (erf((x + width_mm / 2) / (np.sqrt(2) * BLUR_MM)) - erf((x - width_mm / 2) / (np.sqrt(2) * BLUR_MM))) / 2
    hu = np.broadcast_to((40 - 1040 * air)[:, None, None], (60, 12, 12)).astype(np.float32)
    noise = np.random.default_rng(0).normal(0, noise_hu, hu.shape).astype(np.float32)
    return Block(hu + noise, np.zeros(3), STEP_MM)


def width_mm(level: np.ndarray) -> float:
    """Between the two places where a line across the slab crosses the boundary, linear between nodes."""
    line = level[:, 6, 6].astype(np.float64)
    rise = np.flatnonzero((line[:-1] <= 0) & (line[1:] > 0))[0]
    fall = np.flatnonzero((line[:-1] > 0) & (line[1:] <= 0))[-1]
    ends = [i + line[i] / (line[i] - line[i + 1]) for i in (rise, fall)]
    return STEP_MM * (ends[1] - ends[0])


@pytest.mark.parametrize("width", [6.0, 3.0, 2.0])
@pytest.mark.parametrize("shift", [0.0, 0.13, 0.25])
def test_wide_air_ends_where_its_walls_are(width: float, shift: float) -> None:
    assert width_mm(air_level(slab(width, shift))) == pytest.approx(width, abs=0.1)


@pytest.mark.parametrize("shift", [0.0, 0.13, 0.25])
def test_a_slit_of_a_millimetre_keeps_about_its_width(shift: float) -> None:
    assert width_mm(air_level(slab(1.0, shift))) == pytest.approx(1.0, abs=0.3)


@pytest.mark.parametrize("shift", [0.0, 0.13, 0.25])
def test_a_slit_that_one_threshold_closes_stays_open(shift: float) -> None:
    block = slab(0.65, shift)
    assert not (-480 - block.hu > 0).any()
    assert 0.3 < width_mm(air_level(block)) < 1.3


def test_noise_in_tissue_and_in_air_makes_no_walls() -> None:
    level = air_level(slab(8.0, 0.0, noise_hu=60.0))
    x = STEP_MM * (np.arange(60) - 29.5)
    assert (level[np.abs(x) < 3] > 0).all()
    assert (level[np.abs(x) > 5] < 0).all()


def test_bone_beside_air_does_not_move_the_boundary() -> None:
    """Half-way between air and bone would be inside the mucosa's place."""
    soft, bone = slab(6.0, 0.0), slab(6.0, 0.0)
    hu = bone.hu.copy()
    hu[np.abs(STEP_MM * (np.arange(60) - 29.5)) > 4.2] = 1200
    with_bone = Block(hu, bone.origin_mm, STEP_MM)
    assert width_mm(air_level(with_bone)) == pytest.approx(width_mm(air_level(soft)), abs=0.05)
