"""What trials begin with: no more is told than the start says, and it is true."""

from __future__ import annotations

import numpy as np
import pytest

from naris.bench.problems import near_truth, problem
from naris.bench.trials import Noise, Trial
from naris.core.pose import distance
from naris.register.map import RegistrationMap
from naris.register.observation import Observation
from naris.register.register import FROM_POSE
from naris.register.starts import NOTHING

NOISES: tuple[Noise, ...] = ("b", "c", "d")


def test_a_pose_that_is_told_lies_within_2_mm_and_10_degrees_all_through(trial: Trial) -> None:
    rng, off = np.random.default_rng(0), []
    for _ in range(300):
        told = near_truth(trial, rng)
        off.append([float(each) for each in distance(told, trial.anatomy_T_camera)])
    mm, deg = np.array(off).T * [[1.0], [np.rad2deg(1.0)]]
    assert mm.max() <= 2.0 and deg.max() <= 10.0 + 1e-9
    assert mm.mean() == pytest.approx(1.0, abs=0.1)
    assert deg.mean() == pytest.approx(5.0, abs=0.5)


def test_the_true_region_and_it_alone_is_told(tube: RegistrationMap, trial: Trial) -> None:
    regions = tube.anatomy.region_set()
    belief = problem(tube, trial, "b", "region", 0).belief
    assert belief.poses is None
    assert belief.chance(trial.anatomy_T_camera.position_mm[None]) == 1.0
    label = regions.label(tube.places_mm)
    here = int(regions.label(trial.anatomy_T_camera.position_mm))
    np.testing.assert_array_equal(belief.chance(tube.places_mm) > 0, label == here)


@pytest.mark.parametrize("noise", NOISES)
def test_nothing_is_told_where_nothing_is(noise: Noise, tube: RegistrationMap, trial: Trial) -> None:
    asked = problem(tube, trial, noise, "none", 0)
    assert asked.belief is NOTHING
    np.testing.assert_array_equal(asked.look().ranges, trial.observation(noise).ranges)


def test_a_pose_that_is_told_comes_of_the_seed_alone(tube: RegistrationMap, trial: Trial) -> None:
    asked = problem(tube, trial, "b", "pose", 0)
    assert asked.config is FROM_POSE
    again, other = (problem(tube, trial, "b", "pose", seed).belief.poses for seed in (0, 1))
    assert asked.belief.poses is not None and again is not None and other is not None
    np.testing.assert_array_equal(asked.belief.poses.matrix, again.matrix)
    assert np.abs(other.matrix - again.matrix).max() > 0.01


def test_three_views_share_what_is_unknown(tube: RegistrationMap, trial: Trial) -> None:
    """Those without a scale are those with one, all lengths times one factor, where the cameras are too."""
    mm, free = (problem(tube, trial, noise, "views3", 0).look() for noise in ("b", "c"))
    assert mm.views == free.views == 3
    assert not mm.scale.free and free.scale.free
    for view in range(3):  # in whatever order, and one block may be a wall in the one and an edge in the other
        there, here = free.rows(free.view == view), mm.rows(mm.view == view)
        np.testing.assert_allclose(np.sort(there.ranges), trial.scale * np.sort(here.ranges), rtol=0.01)
        np.testing.assert_allclose(there.origins[0], trial.scale * here.origins[0], atol=1e-12)
    assert _met(tube, trial, mm) > 0.9


def test_points_of_three_views_share_what_is_unknown(tube: RegistrationMap, trial: Trial) -> None:
    mm, free = (problem(tube, trial, noise, "views3", 0).look() for noise in ("d", "e"))
    assert free.scale.free and free.views == 3
    for length in ("origins", "ranges", "isotropic"):
        np.testing.assert_allclose(getattr(free, length), trial.scale * getattr(mm, length), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(free.directions, mm.directions, atol=1e-9)


def _met(tube: RegistrationMap, trial: Trial, seen: Observation) -> float:
    """The share of what was seen that lies near a wall, put where the first camera is."""
    points = trial.anatomy_T_camera.apply(seen.origins + seen.ranges[:, None] * seen.directions)
    return float((np.abs(tube.distance(points)) < 0.3 + 0.15 * seen.ranges).mean())
