"""Trials: what is seen from a pose, with noise that is what it is said to be."""

from __future__ import annotations

import numpy as np
import pytest

from naris.bench.trials import FREE_POINTS, NOISES, Trial, drawn_trials
from tests.winding_tube import RADIUS_MM, SLABS, winding_tube


@pytest.fixture(scope="module")
def trials() -> list[Trial]:
    return drawn_trials(winding_tube(), 8, 3)


def test_each_region_comes_equally_often(trials: list[Trial]) -> None:
    names = [SLABS.names[int(SLABS.label(one.anatomy_T_camera.position_mm))] for one in trials]
    assert {name: names.count(name) for name in SLABS.names} == dict.fromkeys(SLABS.names, 2)


def test_the_noise_is_as_large_as_it_is_said(trials: list[Trial]) -> None:
    relative, off = [], []
    for one in trials:
        relative.append((one.ranges["b"] / one.ranges["a"] - 1).ravel())
        np.testing.assert_allclose(one.ranges["c"], one.scale * one.ranges["b"])
        assert 0.5 <= one.scale <= 2
        # Points in a tube are as far from its wall as they are wrong, but for the tenth that lies anywhere.
        reach = one.anatomy_T_camera.apply(one.points)
        nearest = np.linalg.norm(reach[:, None] - winding_tube().passages[0].points_mm[None], axis=2).min(axis=1)
        off.append(nearest - RADIUS_MM)
    spread = np.concatenate(relative)
    assert np.std(spread[np.abs(spread) < 0.3]) == pytest.approx(np.hypot(0.05, 0.3 / RADIUS_MM), rel=0.3)
    assert np.median(np.abs(np.concatenate(off))) == pytest.approx(0.6745 * 0.5, rel=0.3)


def test_without_a_scale_points_are_the_same_but_for_it(trials: list[Trial]) -> None:
    one = trials[0]
    known, free = one.observation("d"), one.observation(FREE_POINTS)
    assert not known.scale.free
    assert free.scale.kind == "unknown"
    assert free.is_cloud
    np.testing.assert_allclose(free.ranges, one.scale * known.ranges)
    np.testing.assert_allclose(free.isotropic, one.scale * known.isotropic)
    np.testing.assert_allclose(free.directions, known.directions)
    assert one.log_scale(FREE_POINTS) == one.log_scale("c") == pytest.approx(-np.log(one.scale))
    assert one.log_scale("d") == 0


def test_every_kind_can_be_given(trials: list[Trial]) -> None:
    assert [len(trials[0].observation(noise)) > 100 for noise in (*NOISES, FREE_POINTS)] == [True] * 5
