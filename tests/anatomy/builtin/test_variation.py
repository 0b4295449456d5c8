"""Noses drawn from the normal ranges."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from naris.anatomy.builtin.correlations import SIZE, SWELLING, correlations, drawn_shares
from naris.anatomy.builtin.layout import layout_of
from naris.anatomy.builtin.parameters import NORMAL_RANGES, NoseParameters
from naris.anatomy.builtin.variation import drawn_parameters


@settings(deadline=None, max_examples=30)
@given(st.integers(0, 2**31))
def test_drawn_noses_are_normal_and_fit_together(seed: int) -> None:
    drawn = drawn_parameters(np.random.default_rng(seed))
    assert all(normal.low <= getattr(drawn, name) <= normal.high for name, normal in NORMAL_RANGES.items())
    layout_of(drawn)
    assert drawn == drawn_parameters(np.random.default_rng(seed))
    assert drawn != NoseParameters()


def test_draws_reach_both_ends_of_every_range() -> None:
    rng = np.random.default_rng(0)
    drawn = [drawn_parameters(rng) for _ in range(60)]
    for name, normal in NORMAL_RANGES.items():
        share = (np.array([getattr(one, name) for one in drawn]) - normal.low) / (normal.high - normal.low)
        assert share.min() < 0.25, name
        assert share.max() > 0.75, name


def test_the_correlations_are_those_of_a_matrix_of_correlations() -> None:
    matrix = correlations()
    assert matrix.shape == (len(NORMAL_RANGES),) * 2
    assert np.allclose(matrix, matrix.T) and np.allclose(np.diag(matrix), 1)
    assert np.linalg.eigvalsh(matrix).min() > 0.1
    assert set(SIZE) | set(SWELLING) <= set(NORMAL_RANGES)


def test_draws_are_uniform_and_correlated_as_said() -> None:
    rng = np.random.default_rng(1)
    shares = np.array([list(drawn_shares(rng).values()) for _ in range(4000)])
    assert np.abs(np.quantile(shares, [0.1, 0.5, 0.9], axis=0) - [[0.1], [0.5], [0.9]]).max() < 0.04
    # Of uniform variables behind which normal ones have a correlation r (Pearson 1907).
    expected = 6 / np.pi * np.arcsin(correlations() / 2)
    assert np.abs(np.corrcoef(shares.T) - expected).max() < 0.08


def test_long_noses_have_long_turbinates_and_swollen_ones_narrow_meatuses() -> None:
    rng = np.random.default_rng(2)
    drawn = [drawn_parameters(rng) for _ in range(400)]

    def together(one: str, other: str) -> float:
        return float(np.corrcoef([getattr(p, one) for p in drawn], [getattr(p, other) for p in drawn])[0, 1])

    assert together("cavity_length_mm", "inferior_length_mm") > 0.4
    assert together("inferior_thickness_mm", "common_meatus_width_mm") < -0.15
    assert abs(together("cavity_length_mm", "valve_angle_deg")) < 0.15
