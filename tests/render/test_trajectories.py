"""Views on the way between keyframes, and keyframes that are set along a passage."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from naris.anatomy.distance import signed_distance
from naris.core.anatomy import Passage
from naris.core.pose import Pose
from naris.errors import InputError, RegionError
from naris.render.directions import tangents, upright
from naris.render.keyframes import Keyframes, interpolate
from naris.render.trajectories import (
    OriginalJitter,
    SteadyHand,
    Steering,
    jitter_views,
    measured,
    roomy_parts,
    trajectory_along,
)
from naris.render.viewpoints import check_in_lumen
from tests.winding_tube import RADIUS_MM, SLABS, centre_line, winding_tube


@pytest.fixture(scope="module")
def distance():
    return signed_distance(winding_tube())


def _nearest(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance to the centre line of the tube, and the index of its nearest point."""
    apart = np.linalg.norm(points[:, None] - centre_line()[None], axis=-1)
    return apart.min(axis=1), apart.argmin(axis=1)


def straight_track(n_mm: float = 12.0):
    positions = np.array([[0, 0, 0], [0, n_mm, 0]], float)
    ahead = np.array([[0.3, 1, 0.2]] * 2)
    return interpolate(Keyframes.of(Pose.look(positions, ahead, np.array([0, 0, 1.0]), "LPS")))


def test_the_original_jitter_is_the_originals(distance) -> None:
    """The same normal numbers, added to the same directions, through `gluLookAt`'s axes written out."""
    track = straight_track()
    views = jitter_views(track, SLABS, np.random.default_rng(4), per_position=10, jitter=OriginalJitter())
    noise = np.random.default_rng(4).normal(0, 0.01, (130, 3))
    forward = np.repeat(track.directions, 10, axis=0) + noise
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    side = np.cross(forward, [0, 0, 1])
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    up = np.cross(side, forward)
    np.testing.assert_allclose(views.anatomy_T_camera.rotation, np.stack([side, -up, forward], axis=-1), atol=1e-12)
    np.testing.assert_allclose(views.anatomy_T_camera.position_mm, np.repeat(track.positions_mm, 10, axis=0))
    assert views.position.tolist() == np.repeat(np.arange(13), 10).tolist()
    assert (views.region == SLABS.label(views.anatomy_T_camera.position_mm)).all()


def test_the_steady_hand_turns_and_moves_as_it_says() -> None:
    track = straight_track(60)
    still = np.repeat(track.anatomy_T_camera.matrix, 200, axis=0)
    hand = SteadyHand(tilt_sd_deg=4.0, roll_sd_deg=2.0, lateral_sd_mm=0.5)
    poses = jitter_views(track, SLABS, np.random.default_rng(0), 200, hand).anatomy_T_camera
    move = np.linalg.inv(still) @ poses.matrix
    np.testing.assert_allclose(move[:, :3, 3].std(axis=0), [0.5, 0.5, 0.0], atol=0.02)
    from scipy.spatial.transform import Rotation

    turn_deg = np.rad2deg(Rotation.from_matrix(move[:, :3, :3]).as_rotvec())
    np.testing.assert_allclose(turn_deg.std(axis=0), [4, 4, 2], rtol=0.05)


def test_no_view_a_position_and_another_frame_are_refused() -> None:
    with pytest.raises(InputError, match="one view"):
        jitter_views(straight_track(), SLABS, np.random.default_rng(0), per_position=0)
    with pytest.raises(RegionError, match="'mean'"):
        jitter_views(straight_track(), replace(SLABS, frame="mean"), np.random.default_rng(0))


@pytest.mark.parametrize("seed", range(6))
def test_a_steered_trajectory_is_inside_and_runs_through_the_passage(distance, seed) -> None:
    steering = Steering()
    keyframes = trajectory_along(winding_tube().passages[0], distance, np.random.default_rng(seed), steering)
    track = interpolate(keyframes)
    check_in_lumen(distance, track.anatomy_T_camera, steering.clearance_mm - 0.15)
    assert track.positions_mm[0, 1] < -30
    assert track.positions_mm[-1, 1] > 30
    gaps = np.linalg.norm(np.diff(keyframes.anatomy_T_camera.position_mm, axis=0), axis=1)
    assert np.median(gaps) > 3
    level = Pose.look(track.positions_mm, track.directions, upright(track.directions), "LPS")
    np.testing.assert_allclose(track.anatomy_T_camera.rotation, level.rotation, atol=1e-6)


def test_trajectories_differ_to_the_side_and_in_aim(distance) -> None:
    """Over many seeds they leave the centre line, look back to it, and their aim wanders by about what was asked."""
    off, aside, back = [], [], []
    steering = Steering(aim_sd_deg=8.0)
    main = winding_tube().passages[0]
    for seed in range(16):
        poses = trajectory_along(main, distance, np.random.default_rng(seed), steering).anatomy_T_camera
        reach, nearest = _nearest(poses.position_mm)
        off.append(reach)
        across = poses.forward - tangents(main)[nearest]
        back.append((across * (centre_line()[nearest] - poses.position_mm)).sum(axis=1) / reach)
        aside.append(np.rad2deg(np.linalg.norm(across, axis=1)))
    assert np.percentile(np.concatenate(off), 80) > 1.5
    assert np.concatenate(back).mean() > 0.03
    assert 10 < np.sqrt((np.concatenate(aside) ** 2).mean()) < 17  # two axes of 8° are 11.3°, the way back some more


def test_a_fixed_up_is_plus_z(distance) -> None:
    steering = Steering(fixed_up=True)
    poses = trajectory_along(winding_tube().passages[0], distance, np.random.default_rng(0), steering).anatomy_T_camera
    np.testing.assert_allclose(poses.rotation[:, 2, 0], 0, atol=1e-9)  # the x axis of the picture is level


def test_the_same_seed_steers_the_same_way(distance) -> None:
    one, two = (
        trajectory_along(winding_tube().passages[0], distance, np.random.default_rng(9)).anatomy_T_camera.matrix
        for _ in range(2)
    )
    assert np.array_equal(one, two)


def test_roomy_parts_are_the_wide_stretches() -> None:
    points = np.stack([np.zeros(101), np.arange(101) / 2, np.zeros(101)], axis=1)
    clearance = np.full(101, 2.0)
    clearance[[30, 35]] = 0.5
    parts = roomy_parts(Passage("p", points, clearance), 1.0)
    assert [round(part.length_mm, 1) for part in parts] == [32.0, 14.5]
    assert roomy_parts(Passage("p", points, clearance), 3.0) == ()


def test_clearance_is_measured_by_the_grid(distance) -> None:
    found = measured(winding_tube().passages[0], distance)
    np.testing.assert_allclose(found.clearance_mm, RADIUS_MM, atol=0.5)
    assert np.array_equal(found.points_mm, winding_tube().passages[0].points_mm)


def test_a_passage_without_room_is_refused(distance) -> None:
    with pytest.raises(RegionError, match=r"9\.0 mm of room"):
        trajectory_along(winding_tube().passages[0], distance, np.random.default_rng(0), Steering(clearance_mm=9.0))
