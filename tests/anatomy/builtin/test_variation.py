"""Noses drawn from the normal ranges."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

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
