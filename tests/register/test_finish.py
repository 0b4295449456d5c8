"""The finalists of a search by another method: right as ours is, judged alike, and refused where it cannot tell."""

import numpy as np
import pytest

from naris.core.pose import CAMERA, Pose, distance
from naris.errors import InputError
from naris.register.equations import MOST_UNKNOWNS
from naris.register.finish import by_points, cloud_noise
from naris.register.noise import UNKNOWN, DepthNoise, PointNoise
from naris.register.observation import from_points, from_ranges, together
from naris.register.rays import prepared, sight
from naris.register.register import RegisterConfig, register
from naris.register.solve import AS_THEY_ARE, fine, judged
from naris.register.starts import NOTHING, Starts
from naris.register.steps import States, solve


def wall_normals(nose, prepared_nose, points, pose):
    """Of the walls nearest to points of a camera, towards it."""
    closest = prepared_nose.distance.closest(pose.apply(points))
    a, b, c = np.moveaxis(nose.vertices_mm[nose.faces[closest.faces]], 1, 0)
    normals = np.cross(b - a, c - a)
    return normals / np.linalg.norm(normals, axis=1, keepdims=True) @ pose.rotation


@pytest.mark.parametrize("method", ["icp", "imlp", "imlop"])
def test_from_near_the_truth_each_method_ends_at_it(nose, prepared_nose, trials, method):
    trial = trials[1]
    truth = trial.anatomy_T_camera
    seen = np.isfinite(trial.ranges["a"])
    points = (trial.rays[seen] * trial.ranges["a"][seen][:, None])[::9]
    normals = wall_normals(nose, prepared_nose, points, truth)
    observation = from_points(points, PointNoise(0.2, 0.05), normals=normals)
    away = truth @ Pose.exp(np.array([0.3, -0.2, 0.2, 0.03, -0.03, 0.02]), CAMERA, CAMERA)
    solved = by_points(prepared_nose, observation, Starts(away.matrix[None], np.zeros(1)), method)
    off_mm, off_rad = distance(Pose(solved.poses[0], truth.target, CAMERA), truth)
    assert off_mm < 0.05 and np.rad2deg(off_rad) < 0.5


@pytest.mark.parametrize("method", ["icp", "imlp"])
def test_a_registration_by_another_method_is_right_too(prepared_nose, trials, method):
    right = 0
    for trial in trials[:4]:
        found = register(prepared_nose, trial.observation("d"), NOTHING, RegisterConfig(120, 4, method=method))
        off_mm, off_rad = distance(found.best, trial.anatomy_T_camera)
        right += off_mm <= 2.0 and np.rad2deg(off_rad) <= 5.0
        assert found.covariance.shape == (6, 6)
    assert right >= 3


def test_poses_are_judged_as_our_solver_judges_them(prepared_nose, trials):
    seen = trials[0].observation("d")
    starts = Starts(trials[0].anatomy_T_camera.matrix[None], np.zeros(1))
    solved = fine(prepared_nose, seen, starts)
    again = judged(prepared_nose, seen, Starts(solved.poses, solved.log_scales))
    np.testing.assert_array_equal(again.poses, solved.poses)
    assert again.costs[0] == pytest.approx(solved.costs[0], rel=1e-4)


def test_judging_fits_the_smooth_error_as_well_as_solving_does(prepared_nose, trials):
    """In −2 log likelihood of all rays: a pose that was solved is not dearer when it is judged from no smooth error."""
    dearer = []
    for trial in trials:
        seen = from_ranges(trial.ranges["b"], trial.rays, DepthNoise())
        away = trial.anatomy_T_camera @ Pose.exp(np.array([0.3, -0.2, 0.2, 0.06, -0.05, 0.04]), CAMERA, CAMERA)
        solved = fine(prepared_nose, seen, Starts(away.matrix[None], np.zeros(1)))
        again = judged(prepared_nose, seen, Starts(solved.poses, solved.log_scales))
        dearer.append((again.costs[0] - solved.costs[0]) * solved.rays)
    assert max(dearer) < 0.5


def test_no_round_of_fitting_the_smooth_error_makes_a_pose_dearer(prepared_nose, trials):
    seen = prepared(prepared_nose, trials[0].observation("b"), fine=True)
    away = trials[0].anatomy_T_camera @ Pose.exp(np.array([0.6, -0.6, 0.5, 0.1, -0.1, 0.1]), CAMERA, CAMERA)
    costs = []
    for rounds in range(12):
        states = States(away.matrix[None].copy(), np.zeros(1), np.zeros((1, MOST_UNKNOWNS)), np.zeros(1))
        solve(sight(prepared_nose, seen), states, AS_THEY_ARE._replace(rounds=rounds), 0, 1)
        costs.append(states.costs[0])
    assert (np.diff(costs) < 1e-5).all()
    assert costs[-1] < costs[2] < costs[0]


def test_depth_is_wrong_along_its_rays(trials):
    seen = from_ranges(trials[0].ranges["b"], trials[0].rays, DepthNoise(smooth=0.05))
    noise = cloud_noise(seen)
    along = np.einsum("ni,nij,nj->n", seen.directions, noise.covariance_mm2, seen.directions)
    np.testing.assert_allclose(along, (0.05 * seen.ranges) ** 2 + seen.radial**2 + seen.isotropic**2, rtol=1e-6)
    assert (np.linalg.eigvalsh(noise.covariance_mm2)[:, 0] < along).all()


def test_normals_are_turned_to_the_camera_and_stay_with_their_points(trials):
    points = trials[0].points
    normals = points / np.linalg.norm(points, axis=1, keepdims=True)
    seen = from_points(points, normals=2.0 * normals)
    np.testing.assert_allclose(seen.normals, -seen.directions, atol=1e-9)
    assert len(seen.some(50).normals) == len(seen.some(50))
    turned = Pose.exp(np.array([1.0, 0, 0, 0, 0.3, 0]), CAMERA, CAMERA)
    both = together([seen, seen], Pose(np.stack([np.eye(4), turned.matrix]), CAMERA, CAMERA))
    np.testing.assert_allclose(both.normals, -both.directions, atol=1e-9)
    with pytest.raises(InputError, match="a normal of some length"):
        from_points(points, normals=np.zeros_like(points))


def test_what_a_method_cannot_use_is_refused(prepared_nose, trials):
    starts = Starts(trials[0].anatomy_T_camera.matrix[None], np.zeros(1))
    with pytest.raises(InputError, match="a known scale for the method imlp"):
        by_points(prepared_nose, from_points(trials[0].points, scale=UNKNOWN), starts, "imlp")
    with pytest.raises(InputError, match="normals for the method imlop"):
        by_points(prepared_nose, trials[0].observation("d"), starts, "imlop")
