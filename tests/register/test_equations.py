"""The equations of a step against differences of the cost, rays against the renderer, and what a solve ends at."""

import numpy as np
import pytest

from naris.core.camera import Intrinsics
from naris.core.pose import CAMERA, Pose
from naris.register.equations import MOST_UNKNOWNS, Equations, cast
from naris.register.noise import DepthNoise, PointNoise, Scale
from naris.register.observation import from_points, from_ranges, together
from naris.register.rays import memory_for, prepared, sight
from naris.register.solve import coarse, fine
from naris.register.starts import Starts
from naris.register.steps import linearise
from naris.render.scene import Scene, render


def cost_at(at, seen, pose, log_scale=0.0, smooth=None, *, is_fine=False):
    ready = prepared(at, seen, fine=is_fine)
    matrix, right = np.zeros((MOST_UNKNOWNS, MOST_UNKNOWNS)), np.zeros(MOST_UNKNOWNS)
    values = np.zeros(MOST_UNKNOWNS) if smooth is None else smooth
    mean = linearise(sight(at, ready), pose.matrix.copy(), log_scale, values, 1.0, Equations(matrix, right))
    return mean * len(seen), matrix, right, ready.model


def bare(ranges, rays, scale=Scale()):
    """Noise that is wide enough for a smooth cost: no outliers to speak of."""
    return from_ranges(ranges, rays, DepthNoise(smooth=0.0, pixel_mm=2.0, outliers=1e-6), scale)


def test_rays_meet_the_walls_that_the_renderer_sees(nose, prepared_nose, trials):
    camera = Intrinsics.from_vertical_fov(32, 32, 80.0)
    depth = render(Scene(nose), trials[0].anatomy_T_camera, camera, want=("depth",)).depth_mm[0]
    seen = from_ranges(depth / camera.rays()[..., 2], camera.rays(), DepthNoise(smooth=0.0, pixel_mm=0.1))
    rays = prepared(prepared_nose, seen, fine=False).rays
    memory = memory_for(rays)
    cast(prepared_nose.embree, rays, trials[0].anatomy_T_camera.matrix.copy(), 1.0, memory)
    real = rays.valid != 0
    np.testing.assert_allclose(np.abs(memory.hit[real]), rays.range[real], rtol=1e-3)
    assert (np.sign(memory.hit[real]) == prepared_nose.inside).all()


@pytest.mark.parametrize("kind", ["ranges", "scaled", "points"])
def test_the_slope_is_that_of_the_cost(prepared_nose, trials, kind):
    """Half the slope of −2 log likelihood, by central differences, at a pose off the truth.

    Walls are curved, and how vaguely a slanted one tells a point is no part of the equations: hence the tolerance.
    """
    trial = trials[0]
    if kind == "points":
        points = (trial.rays * trial.ranges["a"][..., None]).reshape(-1, 3)[::7]
        seen = from_points(points, PointNoise(0.05, 1e-6))
    else:
        seen = bare(trial.ranges["a"], trial.rays, Scale("unknown") if kind == "scaled" else Scale())
    pose = trial.anatomy_T_camera @ Pose.exp(np.array([0.05, -0.03, 0.04, 0.004, 0.003, -0.005]), CAMERA, CAMERA)
    log_scale = 0.02 if kind == "scaled" else 0.0
    _, _, right, model = cost_at(prepared_nose, seen, pose, log_scale)
    steps = np.concatenate([np.eye(6) * np.repeat([0.01, 0.001], 3)[:, None]])
    for k, step in enumerate(steps):
        ahead, behind = (
            cost_at(prepared_nose, seen, pose @ Pose.exp(sign * step, CAMERA, CAMERA), log_scale)[0] for sign in (1, -1)
        )
        slope = -(ahead - behind) / (2 * step[k]) / 2
        assert right[k] == pytest.approx(slope, rel=0.25, abs=0.05 * np.abs(right[:6]).max()), k
    if kind == "scaled":
        ahead, behind = (cost_at(prepared_nose, seen, pose, log_scale + d)[0] for d in (1e-3, -1e-3))
        assert model.free and right[6] == pytest.approx(-(ahead - behind) / 4e-3, rel=0.05)


def test_the_slope_by_the_smooth_error_is_that_of_the_cost(prepared_nose, trials):
    seen = trials[1].observation("b")
    smooth = 0.01 * np.random.default_rng(3).standard_normal(MOST_UNKNOWNS)
    pose = trials[1].anatomy_T_camera
    _, _, right, model = cost_at(prepared_nose, seen, pose, 0.0, smooth, is_fine=True)
    for k in (0, 5, model.smooth - 1):
        moved = np.repeat(smooth[None], 2, axis=0)
        moved[:, k] += [1e-5, -1e-5]
        ahead, behind = (cost_at(prepared_nose, seen, pose, 0.0, values, is_fine=True)[0] for values in moved)
        assert right[6 + k] == pytest.approx(-(ahead - behind) / 4e-5, rel=0.02, abs=0.5)


@pytest.mark.parametrize("noise", ["a", "b", "c", "d"])
def test_a_solve_from_nearby_ends_no_dearer_than_the_truth(prepared_nose, trials, noise):
    trial = trials[2]
    seen, truth = trial.observation(noise), trial.anatomy_T_camera
    away = truth @ Pose.exp(np.array([0.4, -0.3, 0.3, 0.04, -0.05, 0.03]), CAMERA, CAMERA)
    poses = np.stack([away.matrix, truth.matrix])
    scales = np.full(2, trial.log_scale(noise))
    rough = coarse(prepared_nose, seen, Starts(poses, scales))
    found = fine(prepared_nose, seen, Starts(rough.poses[:1], rough.log_scales[:1]))
    right = fine(prepared_nose, seen, Starts(truth.matrix[None], scales[:1]))
    assert found.costs[0] <= right.costs[0] + 0.02
    if noise == "a":
        np.testing.assert_allclose(found.poses[0], truth.matrix, atol=0.03)


def test_solutions_do_not_depend_on_the_threads(prepared_nose, trials, monkeypatch):
    seen, truth = trials[3].observation("b"), trials[3].anatomy_T_camera
    steps = Pose.exp(0.3 * np.random.default_rng(0).standard_normal((9, 6)) * [1, 1, 1, 0.1, 0.1, 0.1], CAMERA, CAMERA)
    starts = Starts(np.array((truth @ steps).matrix), np.zeros(9))
    many = coarse(prepared_nose, seen, starts)
    monkeypatch.setattr("naris.register.threads.cores", lambda: 1)
    one = coarse(prepared_nose, seen, starts)
    np.testing.assert_array_equal(many.poses, one.poses)
    np.testing.assert_array_equal(many.costs, one.costs)


def test_two_views_together_see_what_each_sees_alone(prepared_nose, trials):
    """At their true relative pose the rays of both meet the walls where they should."""
    first, second = trials[0], trials[1]
    relative = first.anatomy_T_camera.inverse() @ second.anatomy_T_camera
    poses = Pose(np.stack([np.eye(4), relative.matrix]), CAMERA, CAMERA)
    both = together([first.observation("a"), second.observation("a")], poses)
    rays = prepared(prepared_nose, both, fine=False).rays
    memory = memory_for(rays)
    cast(prepared_nose.embree, rays, first.anatomy_T_camera.matrix.copy(), 1.0, memory)
    real = rays.valid != 0
    off = np.abs(np.log(np.abs(memory.hit[real]) / rays.range[real]))
    assert np.median(off) < 1e-3 and (off < 0.05).mean() > 0.97
