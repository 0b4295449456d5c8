"""Which views are almost the same, and cameras that are turned away from them."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from naris.core.pose import Pose
from naris.render.near import NEIGHBOUR_DEG, neighbours, turned_away


def cameras(count: int, rng: np.random.Generator, spread_mm: float) -> Pose:
    return Pose.of(
        Rotation.random(count, rng).as_matrix(), spread_mm * rng.standard_normal((count, 3)), "LPS", "camera"
    )


def test_near_is_both_in_place_and_in_direction_whatever_the_roll() -> None:
    unseen = Pose.of(np.eye(3)[None], np.zeros((1, 3)), "LPS", "camera")
    turns = Rotation.from_euler("zx", [[170, 14], [0, 16], [30, 14]], degrees=True).as_matrix()
    views = Pose.of(turns, np.array([[0, 0, 1.9], [0, 0, 0], [0, 2.1, 0]]), "LPS", "camera")
    assert neighbours(unseen, views).tolist() == [True, False, False]


def test_turned_cameras_stand_where_they_stood_and_look_just_past_the_unseen() -> None:
    rng = np.random.default_rng(0)
    unseen, far = cameras(1, rng, 0.0), cameras(200, rng, 30.0)
    turn = Rotation.from_rotvec(0.06 * rng.standard_normal((400, 3))).as_matrix()
    near = Pose.of(unseen.rotation @ turn, 0.3 * rng.standard_normal((400, 3)), "LPS", "camera")
    away = turned_away(unseen, near, rng)
    np.testing.assert_array_equal(away.position_mm, near.position_mm)
    assert neighbours(unseen, near).all()
    assert not neighbours(unseen, away).any()
    off_deg = np.rad2deg(np.arccos(away.forward @ unseen.forward[0]))
    assert off_deg.min() >= NEIGHBOUR_DEG
    assert np.median(off_deg) < NEIGHBOUR_DEG + 6
    # To every side alike: what the cameras see surrounds what is not seen.
    side = (away.forward - (away.forward @ unseen.forward.T) * unseen.forward) @ unseen.rotation[0]
    quarter = (np.arctan2(side[:, 1], side[:, 0]) // (np.pi / 2)).astype(int)
    assert np.bincount(quarter + 2, minlength=4).min() > 60
    others = neighbours(unseen, far)
    np.testing.assert_array_equal(turned_away(unseen, far, rng).matrix[~others], far.matrix[~others])


def test_many_unseen_views_of_one_place_are_left_together() -> None:
    """As the ten views of a position, which look almost the same way: past one of them is past them all."""
    rng = np.random.default_rng(1)
    middle = cameras(1, rng, 0.0)
    wobble = Rotation.from_rotvec(0.01 * rng.standard_normal((10, 3))).as_matrix()
    unseen = Pose.of(middle.rotation @ wobble, np.zeros((10, 3)), "LPS", "camera")
    near = Pose.of(np.repeat(middle.rotation, 300, axis=0), np.zeros((300, 3)), "LPS", "camera")
    assert not neighbours(unseen, turned_away(unseen, near, rng)).any()
