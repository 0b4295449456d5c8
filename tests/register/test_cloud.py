"""The likelihood of a cloud against the sum that it stands for, and its slope against differences of the cost."""

import numpy as np
import pytest
from numba import njit

from naris.core.camera import Intrinsics
from naris.core.pose import CAMERA, Pose
from naris.register.cloud_equations import Seen, _off
from naris.register.equations import MOST_UNKNOWNS, Equations
from naris.register.noise import PointNoise, Scale
from naris.register.observation import from_points, together
from naris.register.rays import prepared, rays_of, sight
from naris.register.solve import fine
from naris.register.starts import Starts
from naris.register.steps import linearise
from naris.render.lanes import LANES, store
from naris.render.scene import Scene, render

SD_MM, OUTLIERS = 0.6, 0.05


def cloud(trial, rng, count=150, scale=1.0, known=Scale()):
    """Places on the wall that a camera sees, with noise in every direction."""
    places = (trial.rays * trial.ranges["a"][..., None]).reshape(-1, 3)
    points = places[rng.choice(len(places), count, replace=False)] + SD_MM * rng.standard_normal((count, 3))
    return from_points(points / scale, PointNoise(SD_MM / scale, OUTLIERS), known)


def at_pose(at, seen, pose, log_scale=0.0):
    matrix, right = np.zeros((MOST_UNKNOWNS, MOST_UNKNOWNS)), np.zeros(MOST_UNKNOWNS)
    ready = prepared(at, seen, fine=True)
    mean = linearise(sight(at, ready), pose.matrix.copy(), log_scale, np.zeros(MOST_UNKNOWNS), 1.0,
                     Equations(matrix, right))  # fmt: skip
    return mean * len(seen), right


def by_sum(nose, seen, pose):
    """The same from the definition: normals about each pixel of a fine picture, by their solid angles."""
    camera = Intrinsics.from_vertical_fov(320, 320, 125.0)
    rays = camera.rays().reshape(-1, 3)
    depth = render(Scene(nose), pose, camera, want=("depth",)).depth_mm[0].ravel()
    there = depth > 0
    places = rays[there] * (depth[there] / rays[there, 2])[:, None]
    solid = rays[there, 2] ** 3 / (camera.fx * camera.fy)
    points = seen.directions * seen.ranges[:, None]
    cost = 0.0
    for point, r in zip(points, seen.ranges, strict=True):
        off = np.exp(-0.5 * ((places - point) ** 2).sum(axis=1) / SD_MM**2)
        density = r**2 * (solid * off).sum() / (SD_MM * np.sqrt(2 * np.pi)) ** 3
        cost -= 2 * np.log((1 - OUTLIERS) * density + OUTLIERS / (3 * np.median(seen.ranges)))
    return cost


@pytest.mark.parametrize("number", [0, 2])
def test_the_cost_is_that_of_all_that_is_seen_around_each_point(nose, prepared_nose, trials, number):
    seen, truth = cloud(trials[number], np.random.default_rng(number)), trials[number].anatomy_T_camera
    away = truth @ Pose.exp(np.array([0.8, -0.5, 0.6, 0.05, -0.06, 0.04]), CAMERA, CAMERA)
    ours, theirs = (np.array([one(pose) for pose in (truth, away)]) for one in (
        lambda pose: at_pose(prepared_nose, seen, pose)[0], lambda pose: by_sum(nose, seen, pose)
    ))  # fmt: skip
    np.testing.assert_allclose(ours, theirs, atol=0.3 * len(seen))  # patches blur what is slanted
    assert ours[1] - ours[0] == pytest.approx(theirs[1] - theirs[0], rel=0.2)


@pytest.mark.parametrize("free", [False, True])
def test_the_slope_is_that_of_the_cost(prepared_nose, trials, free):
    """Over steps that are long beside the way from ray to ray, at which a ray may leave an edge."""
    trial = trials[0]
    scale = 2.0 if free else 1.0
    seen = cloud(trial, np.random.default_rng(1), scale=scale, known=Scale("unknown") if free else Scale())
    pose = trial.anatomy_T_camera @ Pose.exp(np.array([0.4, -0.3, 0.3, 0.03, 0.02, -0.04]), CAMERA, CAMERA)
    log_scale = np.log(scale) + 0.05 if free else 0.0
    _, right = at_pose(prepared_nose, seen, pose, log_scale)
    steps = np.diag(np.repeat([0.15, 0.02], 3))
    slopes = []
    for step in steps:
        ahead, behind = (
            at_pose(prepared_nose, seen, pose @ Pose.exp(sign * step, CAMERA, CAMERA), log_scale)[0] for sign in (1, -1)
        )
        slopes.append(-(ahead - behind) / (4 * step.max()))
    for part in (slice(0, 3), slice(3, 6)):
        np.testing.assert_allclose(right[part], slopes[part], atol=0.2 * np.abs(slopes[part]).max())
    if free:
        ahead, behind = (at_pose(prepared_nose, seen, pose, log_scale + d)[0] for d in (0.02, -0.02))
        assert right[6] == pytest.approx(-(ahead - behind) / 0.08, rel=0.2)


def test_a_unit_of_the_cloud_changes_nothing(prepared_nose, trials):
    pose = trials[1].anatomy_T_camera
    plain = cloud(trials[1], np.random.default_rng(4), known=Scale("unknown"))
    other = cloud(trials[1], np.random.default_rng(4), scale=1.7, known=Scale("unknown"))
    cost, right = at_pose(prepared_nose, plain, pose)
    scaled, turned = at_pose(prepared_nose, other, pose, np.log(1.7))
    # Densities are in the unit of the cloud.
    assert scaled + 2 * len(other) * np.log(1.7) == pytest.approx(cost, rel=1e-3)
    np.testing.assert_allclose(turned[:6], right[:6], rtol=0.02, atol=0.02 * np.abs(right[:6]).max())


def test_two_views_together_cost_what_each_does(prepared_nose, trials):
    first, second = trials[0], trials[1]
    seen = [cloud(one, np.random.default_rng(k)) for k, one in enumerate((first, second))]
    relative = first.anatomy_T_camera.inverse() @ second.anatomy_T_camera
    both = together(seen, Pose(np.stack([np.eye(4), relative.matrix]), CAMERA, CAMERA))
    apart = [
        at_pose(prepared_nose, one, trial.anatomy_T_camera)[0] for one, trial in zip(seen, trials[:2], strict=True)
    ]
    assert at_pose(prepared_nose, both, first.anatomy_T_camera)[0] == pytest.approx(sum(apart), rel=0.03)


def test_a_solve_ends_near_the_truth(prepared_nose, trials):
    trial = trials[0]
    seen = cloud(trial, np.random.default_rng(2), 500)
    away = trial.anatomy_T_camera @ Pose.exp(np.array([0.5, -0.4, 0.4, 0.04, -0.05, 0.03]), CAMERA, CAMERA)
    found = fine(prepared_nose, seen, Starts(away.matrix[None], np.zeros(1)))
    truth = fine(prepared_nose, seen, Starts(trial.anatomy_T_camera.matrix[None], np.zeros(1)))
    assert np.linalg.norm(found.poses[0, :3, 3] - trial.anatomy_T_camera.position_mm) < 0.5
    assert found.costs[0] <= truth.costs[0] + 0.02


def test_points_right_before_the_camera_are_no_harm(prepared_nose, trials):
    """Their windows reach around the camera, where rows of one elevation would turn over."""
    seen = cloud(trials[0], np.random.default_rng(3))
    points = np.vstack([seen.directions * seen.ranges[:, None], [[0.3, 0.7, 0.05], [-0.2, -0.5, 0.01]]])
    cost, right = at_pose(prepared_nose, from_points(points, PointNoise(SD_MM, OUTLIERS)), trials[0].anatomy_T_camera)
    assert np.isfinite(cost) and np.isfinite(right).all()


@njit
def _offs(rays, seen, point, variance, out):
    for row, one in enumerate(_off(rays, seen, point, variance, 0)):
        store(out, row * LANES, one)


def test_off_a_wall_is_told_truly_however_slanted_it_is():
    """Across a wall, away along it and level: the three parts of the way to a point, at 0.5° as at 60°."""
    rng = np.random.default_rng(6)
    tilt = np.deg2rad(np.linspace(0.5, 80, LANES))
    ray = rng.standard_normal((LANES, 3))
    ray /= np.linalg.norm(ray, axis=1, keepdims=True)
    side = np.cross(ray, rng.standard_normal((LANES, 3)))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    wall = np.cos(tilt)[:, None] * side - np.sin(tilt)[:, None] * ray
    along = np.cos(tilt)[:, None] * ray + np.sin(tilt)[:, None] * side
    t, point, ones = rng.uniform(5, 30, LANES), np.array([4.0, -7.0, 9.0]), np.ones(LANES)
    rays = rays_of(np.zeros((LANES, 3)), ray, ones, ones, ones)
    patch = rng.uniform(0.01, 0.1, LANES)
    as_float = [np.ascontiguousarray(x, dtype=np.float32) for x in (t, wall.T, (wall * ray).sum(1), patch)]
    nothing = np.zeros(LANES, np.float32)
    out = np.zeros((6, LANES), np.float32)
    _offs(rays, Seen(*as_float, nothing, nothing, nothing), tuple(np.float32(point)), np.float32(0.36), out.ravel())
    off = point - t[:, None] * ray
    across, away = (off * wall).sum(1), (off * along).sum(1)
    level = (off * off).sum(1) - across**2 - away**2
    slanted = np.maximum(np.sin(tilt), 0.1)
    expected = across, away, level, 1 / (patch / slanted**2 + 0.36), 1 / (patch + 0.36), -np.cos(tilt) / slanted
    np.testing.assert_allclose(out, expected, rtol=2e-4, atol=2e-4)
