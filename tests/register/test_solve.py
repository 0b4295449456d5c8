"""Which coarse solutions go on, and what is begun again beside the best."""

from __future__ import annotations

import numpy as np
import pytest

from naris.core.pose import CAMERA, Pose
from naris.register.equations import RANGES, Model
from naris.register.noise import DepthNoise
from naris.register.observation import from_ranges
from naris.register.solve import Solutions, aside, different, fine, merged, promising
from naris.register.starts import Starts

MODEL = Model(RANGES, 0.05, 10.0, 0, 0.0, 0.0, -np.inf, np.inf, 1, 0)


def solutions(costs: list[float], rays: int = 100) -> Solutions:
    """10 mm apart from one another."""
    poses = np.tile(np.eye(4), (len(costs), 1, 1))
    poses[:, 0, 3] = 10.0 * np.arange(len(costs))
    matrices = np.arange(len(costs))[:, None, None] * np.ones((1, 6, 6))
    return Solutions(poses, 0.1 * np.arange(len(costs)), np.array(costs), rays, MODEL, matrices)


def test_what_is_far_behind_in_all_rays_together_does_not_go_on() -> None:
    """1.0 a ray of 100 rays is a −2 log likelihood of 100."""
    assert len(promising(solutions([2.0, 2.5, 2.9, 3.1, 4.0]), 8).poses) == 3
    assert len(promising(solutions([2.0, 2.5, 2.9, 3.1, 4.0]), 2).poses) == 2
    assert len(promising(solutions([2.0, 2.5, 2.9, 3.1, 4.0], rays=10), 8).poses) == 5
    kept = promising(solutions([2.0, 2.5, 9.0]), 8)
    np.testing.assert_allclose(kept.poses[:, 0, 3], [0.0, 10.0])
    np.testing.assert_allclose(kept.log_scales, [0.0, 0.1])


def test_what_lies_at_one_place_with_two_scales_is_two_where_scales_are_asked_for() -> None:
    found = solutions([1.0, 2.0, 3.0, 4.0])
    found.poses[:, 0, 3] = [0.0, 0.1, 0.1, 10.0]
    found.log_scales[:] = [0.0, 0.01, 0.1, 0.0]
    assert different(found, 4, 0.15, 0.02).tolist() == [0, 3]
    assert different(found, 4, 0.15, 0.02, 0.02).tolist() == [0, 2, 3]
    assert different(found, 2, 0.15, 0.02, 0.02).tolist() == [0, 2]


def test_what_begins_aside_lies_around_the_best_at_its_scale() -> None:
    found = solutions([1.0, 2.0])
    found.poses[0] = Pose.exp(np.array([3.0, -4.0, 5.0, 0.4, -0.3, 0.2]), CAMERA, CAMERA).matrix
    starts = aside(found, "LPS", 4000, np.random.default_rng(0))
    off = np.linalg.inv(found.poses[0]) @ starts.poses
    assert off[:, :3, 3].mean(axis=0) == pytest.approx(np.zeros(3), abs=0.03)
    assert off[:, :3, 3].std(axis=0) == pytest.approx(np.full(3, 0.4), rel=0.05)
    turn = np.stack([off[:, 2, 1] - off[:, 1, 2], off[:, 0, 2] - off[:, 2, 0], off[:, 1, 0] - off[:, 0, 1]]) / 2
    assert turn.std(axis=1) == pytest.approx(np.full(3, np.deg2rad(5.0)), rel=0.05)
    assert (starts.log_scales == found.log_scales[0]).all()


def test_both_together_are_best_first_each_with_its_own() -> None:
    first, second = solutions([1.0, 4.0, 6.0]), solutions([0.5, 5.0])
    both = merged(first, second)
    assert both.costs.tolist() == [0.5, 1.0, 4.0, 5.0, 6.0]
    np.testing.assert_allclose(both.poses[:, 0, 3], [0.0, 0.0, 10.0, 10.0, 20.0])
    assert both.matrices[:, 0, 0].tolist() == [0.0, 0.0, 1.0, 1.0, 2.0]
    assert merged(first, Solutions(second.poses, second.log_scales, second.costs, 100, MODEL)).matrices is None


def test_beginning_again_beside_a_solution_leaves_dents_of_the_costs(prepared_nose, trials) -> None:
    """From 1 mm and 7° off a solve often rests in a dent; what begins beside it finds a deeper place."""
    left = 0
    for k, trial in enumerate(trials):
        seen = from_ranges(trial.ranges["b"], trial.rays, DepthNoise())
        away = trial.anatomy_T_camera @ Pose.exp(np.array([0.6, -0.6, 0.5, 0.08, -0.07, 0.06]), CAMERA, CAMERA)
        first = fine(prepared_nose, seen, Starts(away.matrix[None], np.zeros(1)))
        again = fine(prepared_nose, seen, aside(first, prepared_nose.anatomy.frame, 8, np.random.default_rng(k)))
        left += (first.costs[0] - again.costs[0]) * first.rays > 1.0
    assert left >= len(trials) // 3
