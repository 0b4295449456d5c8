"""Where registrations begin: near the truth, and the nearer the more views there are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from naris.bench.trials import Trial, neighbours_of
from naris.core.anatomy import Anatomy
from naris.core.pose import CAMERA, Pose, distance
from naris.errors import InputError, PoseError
from naris.register.map import RegistrationMap
from naris.register.noise import UNKNOWN
from naris.register.observation import Observation, together
from naris.register.solve import BASIN_MM, BASIN_RAD, alike
from naris.register.starts import NOTHING, Belief, find_starts, near

NEAR_MM, NEAR_DEG = 3.0, 20.0


def first_near(at: RegistrationMap, observation: Observation, truth: Pose) -> int:
    """How many starts are tried before one near the truth."""
    starts = find_starts(at, observation, NOTHING, 400, np.random.default_rng(0))
    off_mm, off_rad = distance(Pose(starts.poses, truth.target, CAMERA), truth)
    near = np.flatnonzero((off_mm < NEAR_MM) & (np.rad2deg(off_rad) < NEAR_DEG))
    return int(near[0]) if len(near) else 400


def test_other_views_bring_a_start_near_the_truth_forward(
    nose: Anatomy, prepared_nose: RegistrationMap, trials: list
) -> None:
    alone, with_others = [], []
    for number, trial in enumerate(trials):
        views, rig_T_camera = neighbours_of(nose, trial, 2, number)
        seen = [one.observation("b") for one in views]
        # A whole first view finds its place by itself.
        seen[0] = seen[0].rows(seen[0].directions[:, 2] > np.cos(np.deg2rad(15)))
        alone.append(first_near(prepared_nose, seen[0], trial.anatomy_T_camera))
        with_others.append(first_near(prepared_nose, together(seen, rig_T_camera), trial.anatomy_T_camera))
    assert sum(with_others) < 0.5 * sum(alone)
    assert np.median(with_others) < 20


def test_other_views_of_an_unknown_unit_stand_where_the_scale_puts_them(
    nose: Anatomy, prepared_nose: RegistrationMap, trials: list
) -> None:
    """The unit of the rig is that of the depth: in another unit the starts are the same, but for rounding."""
    trial = trials[0]
    views, rig_T_camera = neighbours_of(nose, trial, 2, 0)
    joined = together([one.observation("b") for one in views], rig_T_camera)
    free = replace(joined, scale=UNKNOWN)
    half = replace(free, ranges=joined.ranges / 2, origins=joined.origins / 2, radial=joined.radial / 2)
    one, other = (find_starts(prepared_nose, seen, NOTHING, 50, np.random.default_rng(0)) for seen in (free, half))
    shared = sum(any(np.allclose(pose, another) for another in other.poses) for pose in one.poses)
    assert shared > 25


def test_of_several_views_as_many_starts_come_from_each_region_as_of_one(
    nose: Anatomy, prepared_nose: RegistrationMap, trials: list
) -> None:
    """A belief in one region keeps its share, wherever the views fit best."""
    regions, count = nose.region_set(), 200
    believed = regions.names[-1]
    rest = {name: 0.1 / (len(regions.names) - 1) for name in regions.names[:-1]}
    belief = Belief(regions, {believed: 0.9, **rest})
    for number, trial in enumerate(trials[:4]):
        views, rig_T_camera = neighbours_of(nose, trial, 1, number)
        seen = together([one.observation("b") for one in views], rig_T_camera)
        starts = find_starts(prepared_nose, seen, belief, count, np.random.default_rng(0))
        label = regions.label(starts.poses[:, :3, 3])
        assert len(starts.poses) >= count - len(regions.names)
        assert (label == regions.names.index(believed)).sum() >= 80


def test_regions_of_the_same_chance_get_as_many_starts_each(
    nose: Anatomy, prepared_nose: RegistrationMap, trials: list[Trial]
) -> None:
    """Two of equal chance are two regions, and not one of that chance."""
    regions, count = nose.region_set(), 200
    first, second, *rest = regions.names
    chances = {first: 0.4, second: 0.4, **dict.fromkeys(rest, 0.2 / len(rest))}
    for trial in trials[:4]:
        seen = trial.observation("b")
        starts = find_starts(prepared_nose, seen, Belief(regions, chances), count, np.random.default_rng(0))
        label = regions.label(starts.poses[:, :3, 3])
        for name in (first, second):
            assert (label == regions.names.index(name)).sum() >= 40


def test_no_twenty_of_two_hundred_starts_lie_in_one_basin(prepared_nose: RegistrationMap, trials: list[Trial]) -> None:
    """What is alike would end alike: the most that may be lost to that is a tenth, and of places there are many."""
    for trial in trials:
        poses = find_starts(prepared_nose, trial.observation("b"), NOTHING, 200, np.random.default_rng(0)).poses
        near = np.stack([alike(poses, pose, BASIN_MM, BASIN_RAD) for pose in poses])
        assert near.sum(axis=1).max() < 20
        apart = [k for k in range(len(poses)) if not near[k, :k].any()]
        assert len(apart) >= 30


def test_believed_poses_begin_with_the_scale_that_their_walls_have(prepared_nose, trials):
    for trial in trials:
        believed = near(trial.anatomy_T_camera, np.diag([0.01] * 3 + [1e-4] * 3)[None])
        starts = find_starts(prepared_nose, trial.observation("c"), believed, 4, np.random.default_rng(0))
        np.testing.assert_allclose(starts.log_scales, trial.log_scale("c"), atol=0.15)
        known = find_starts(prepared_nose, trial.observation("b"), believed, 4, np.random.default_rng(0))
        assert not known.log_scales.any()


def test_every_believed_pose_is_begun_from_however_many_there_are(prepared_nose, trials):
    truth = trials[0].anatomy_T_camera
    steps = np.zeros((30, 6))
    steps[:, 0] = np.linspace(-3, 3, 30)
    poses = truth.reshape(1) @ Pose.exp(steps, CAMERA, CAMERA)
    belief = near(poses, np.tile(np.eye(6), (30, 1, 1)))
    starts = find_starts(prepared_nose, trials[0].observation("b"), belief, 8, np.random.default_rng(0))
    np.testing.assert_allclose(starts.poses, poses.matrix, atol=1e-9)


def test_beliefs_that_cannot_be_are_told(trials):
    pose = trials[0].anatomy_T_camera.reshape(1)
    with pytest.raises(InputError, match="for each of 1 poses"):
        near(pose, np.eye(6))
    with pytest.raises(InputError, match="negative variance"):
        near(pose, -np.eye(6)[None])
    for wrong in (np.full((1, 6, 6), np.nan), np.eye(6)[None] + np.eye(6, k=1)):
        with pytest.raises(InputError, match="symmetric"):
            near(pose, wrong)
    with pytest.raises(InputError, match="poses to begin from alone"):
        Belief(only_poses=True)
    with pytest.raises(PoseError, match="anatomy_T_camera"):
        near(Pose(pose.matrix, "LPS", "LPS"), np.eye(6)[None])
