"""Target registration error: laws of how far a pose puts targets from where they are."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from naris.core.pose import CAMERA, Pose
from naris.core.targets import expected_errors_mm, target_errors_mm, wall_ahead_mm
from naris.errors import PoseError

SEEDS = st.integers(0, 2**32 - 1)
TARGETS_MM = np.random.default_rng(1).normal(0, 20, (17, 3))
RAYS = np.stack(np.broadcast_arrays(*np.meshgrid(np.linspace(-0.8, 0.8, 9), np.linspace(-0.8, 0.8, 9)), 1.0), axis=-1)
RAYS /= np.linalg.norm(RAYS, axis=-1, keepdims=True)


def poses(seed: int, count: int) -> list[Pose]:
    """Camera poses anywhere."""
    rng = np.random.default_rng(seed)
    twists = rng.normal(0, 1, (count, 6)) * [9, 9, 9, 0.8, 0.8, 0.8]
    return [Pose.exp(twist, "LPS", CAMERA) for twist in twists]


@given(SEEDS)
def test_the_true_pose_has_no_error(seed: int) -> None:
    (true,) = poses(seed, 1)
    np.testing.assert_allclose(target_errors_mm(true, true, TARGETS_MM), 0, atol=1e-10)


@given(SEEDS)
def test_a_shift_is_the_error_of_every_target(seed: int) -> None:
    (true,) = poses(seed, 1)
    step = np.random.default_rng(seed).normal(0, 5, 3)
    found = Pose.of(true.rotation, true.position_mm + step, "LPS", CAMERA)
    np.testing.assert_allclose(target_errors_mm(found, true, TARGETS_MM), np.linalg.norm(step), rtol=1e-9)


@given(SEEDS)
def test_a_turn_about_the_camera_costs_a_target_its_distance(seed: int) -> None:
    """Twice the sine of half the angle, times how far it is from the axis."""
    (true,) = poses(seed, 1)
    angle = 0.3
    found = true @ Pose.exp(np.array([0, 0, 0, 0, 0, angle]), CAMERA, CAMERA)
    in_camera = true.inverse().apply(TARGETS_MM)
    from_axis = np.linalg.norm(in_camera[:, :2], axis=1)
    np.testing.assert_allclose(target_errors_mm(found, true, TARGETS_MM), 2 * np.sin(angle / 2) * from_axis, rtol=1e-8)


@given(SEEDS)
def test_another_frame_of_the_anatomy_changes_nothing(seed: int) -> None:
    found, true, moved = poses(seed, 3)
    other = Pose(moved.matrix, "other", "LPS")
    there = target_errors_mm(other @ found, other @ true, other.apply(TARGETS_MM))
    np.testing.assert_allclose(there, target_errors_mm(found, true, TARGETS_MM), atol=1e-8)


@given(SEEDS)
def test_another_place_for_the_camera_in_its_scope_changes_nothing(seed: int) -> None:
    """Both poses after the same transform on the right: where the scope is does not depend on what of it is named."""
    found, true, moved = poses(seed, 3)
    inner = Pose(moved.matrix, CAMERA, CAMERA)
    there = target_errors_mm(found @ inner, true @ inner, TARGETS_MM)
    np.testing.assert_allclose(there, target_errors_mm(found, true, TARGETS_MM), atol=1e-8)


def test_poses_of_two_frames_are_refused() -> None:
    found, true = poses(0, 2)
    with pytest.raises(PoseError, match="LPS_T_camera"):
        target_errors_mm(Pose(found.matrix, "mean", CAMERA), true, TARGETS_MM)


def test_the_wall_ahead_lies_around_the_axis_where_it_was_met() -> None:
    (true,) = poses(3, 1)
    ranges = np.full(RAYS.shape[:2], 7.0)
    seen = true.inverse().apply(wall_ahead_mm(true, ranges, RAYS, 20.0))
    assert 0 < len(seen) < RAYS.shape[0] * RAYS.shape[1]
    np.testing.assert_allclose(np.linalg.norm(seen, axis=1), 7.0)
    assert (seen[:, 2] / 7.0 >= np.cos(np.deg2rad(20.0))).all()


def test_where_nothing_is_met_ahead_the_whole_wall_counts() -> None:
    (true,) = poses(4, 1)
    ranges = np.where(RAYS[..., 2] > 0.85, np.nan, 7.0)
    assert len(wall_ahead_mm(true, ranges, RAYS, 20.0)) == int(np.isfinite(ranges).sum()) > 0


@settings(max_examples=10)
@given(SEEDS)
def test_what_is_expected_is_what_poses_off_by_the_covariance_come_to(seed: int) -> None:
    """Twists whose second moment is exactly the covariance, small enough for the first order to hold."""
    (found,) = poses(seed, 1)
    root = np.random.default_rng(seed).normal(0, 1e-4, (6, 6))
    twists = np.sqrt(6) * np.concatenate([root.T, -root.T])
    errors = [target_errors_mm(found @ Pose.exp(twist, CAMERA, CAMERA), found, TARGETS_MM) for twist in twists]
    off = np.sqrt(np.mean(np.square(errors), axis=0))
    np.testing.assert_allclose(expected_errors_mm(found, root @ root.T, TARGETS_MM), off, rtol=1e-2)


def test_an_angle_costs_what_is_far_more_than_what_is_near() -> None:
    found, covariance = Pose.of(np.eye(3), np.zeros(3), "LPS", CAMERA), np.diag([0.0, 0, 0, 0.1**2, 0, 0])
    far = expected_errors_mm(found, covariance, np.array([[0.0, 0, 10], [0, 0, 60], [50, 0, 0]]))
    np.testing.assert_allclose(far, [1.0, 6.0, 0.0], atol=1e-12)
