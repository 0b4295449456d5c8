"""Distances that are sought in a box are those of the whole lattice, to the last bit."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.ndimage import distance_transform_edt

from naris.airway.near import box_of, deep_mm, within_mm

SHAPE = (14, 17, 20)


@st.composite
def masks(draw: st.DrawFn) -> np.ndarray:
    """Nodes in some box of a lattice, dense or few; always one that is none of it, and one that is."""
    box = tuple(slice(*sorted((draw(st.integers(0, n)), draw(st.integers(0, n))))) for n in SHAPE)
    mask = np.zeros(SHAPE, bool)
    chance = np.random.default_rng(draw(st.integers(0, 2**31))).random(SHAPE)
    mask[box] = chance[box] < draw(st.sampled_from([0.02, 0.5, 1.0]))
    mask[tuple(draw(st.integers(0, n - 1)) for n in SHAPE)] = True
    mask[tuple(draw(st.integers(0, n - 1)) for n in SHAPE)] = False
    return mask


@settings(max_examples=60)
@given(masks(), st.sampled_from([0.5, 0.8, 2.0]), st.sampled_from([0.4, 1.0, 1.5, 8.0]))
def test_they_are_those_of_the_whole_lattice(mask: np.ndarray, step_mm: float, most_mm: float) -> None:
    assert np.array_equal(deep_mm(mask, step_mm), distance_transform_edt(mask) * step_mm)
    if mask.any():
        assert np.array_equal(within_mm(mask, most_mm, step_mm), distance_transform_edt(~mask) * step_mm <= most_mm)


@given(masks(), st.integers(0, 3))
def test_a_box_holds_all_and_touches_on_every_side(mask: np.ndarray, around: int) -> None:
    inside = mask[box_of(mask)]
    assert inside.sum() == mask.sum()
    if mask.any():
        assert all(np.take(inside, end, axis).any() for axis in range(3) for end in (0, -1))
        for one, wide, size in zip(box_of(mask), box_of(mask, around), SHAPE, strict=True):
            assert (wide.start, wide.stop) == (max(one.start - around, 0), min(one.stop + around, size))


@pytest.mark.parametrize("around", [0, 2])
def test_nothing_has_an_empty_box_and_is_near_to_nothing(around: int) -> None:
    none = np.zeros(SHAPE, bool)
    assert none[box_of(none, around)].size == 0
    assert not within_mm(none, 5.0, 0.5).any()
    assert not deep_mm(none, 0.5).any()
