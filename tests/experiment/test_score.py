"""What the report is told of poses."""

from __future__ import annotations

import numpy as np

from naris.core.pose import Pose, stack
from naris.experiment.score import pose_errors


def test_errors_are_those_of_the_best_hypothesis() -> None:
    truth = stack([Pose.identity("LPS", "camera"), Pose.identity("LPS", "camera")])
    near = Pose.exp(np.array([3.0, 0.0, 0.0, 0.0, 0.0, np.deg2rad(10)]), "LPS", "camera")
    far = Pose.exp(np.array([20.0, 0.0, 0.0, 0.0, 1.0, 0.0]), "LPS", "camera")
    found = pose_errors(stack([stack([near, far]), stack([far, near])]), truth)
    assert found is not None
    assert np.allclose(found.position_mm, np.linalg.norm(np.stack([near.position_mm, far.position_mm]), axis=1))
    assert np.allclose(found.rotation_deg, [10.0, np.rad2deg(1.0)])


def test_a_network_without_poses_has_no_pose_errors() -> None:
    assert pose_errors(None, stack([Pose.identity("LPS", "camera")])) is None
