"""What the splits promise, checked by brute force over all pairs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from naris.anatomy.distance import signed_distance
from naris.core.anatomy import SlabRegions
from naris.core.pose import Pose
from naris.core.pose import distance as apart
from naris.dataset.splits import SplitSizes, check_no_neighbours, make_splits, neighbours
from naris.errors import DatasetError, PoseError, RegionError
from naris.render.scene import Scene
from naris.render.trajectories import Steering
from naris.render.viewpoints import check_in_lumen, sees_ahead
from tests.winding_tube import SLABS, winding_tube

SIZES = SplitSizes(train_positions=60, test_positions=10, per_position=4)


@pytest.fixture(scope="module")
def splits():
    return make_splits(winding_tube(), SLABS, np.random.default_rng(0), SIZES)


def pairs(train: Pose, test: Pose) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of every test (rows) against every training view: mm between centres, degrees between directions and in all."""
    n, m = len(test), len(train)
    one = Pose(np.repeat(test.matrix, m, axis=0), test.target, test.source)
    other = Pose(np.tile(train.matrix, (n, 1, 1)), train.target, train.source)
    mm, turn = apart(one, other)
    between = np.arccos(np.clip((one.forward * other.forward).sum(axis=1), -1, 1))
    return mm.reshape(n, m), np.rad2deg(between).reshape(n, m), np.rad2deg(turn).reshape(n, m)


def test_the_counts_are_those_asked_and_the_regions_balanced(splits) -> None:
    assert (len(splits.train), len(splits.published), len(splits.trajectory)) == (240, 40, 40)
    for views, least, most in ((splits.train, 13, 17), (splits.published, 2, 3), (splits.trajectory, 2, 3)):
        positions = np.bincount(views.region, minlength=4) / 4
        assert positions.min() >= least
        assert positions.max() <= most
        assert (views.region == SLABS.label(views.anatomy_T_camera.position_mm)).all()
        assert (np.bincount(views.position)[np.unique(views.position)] == 4).all()


def test_no_trajectory_view_has_a_neighbour_and_every_published_view_has(splits) -> None:
    mm, direction, turn = pairs(splits.train.anatomy_T_camera, splits.trajectory.anatomy_T_camera)
    assert not ((mm < 2) & (direction < 15)).any()
    assert not ((mm < 2) & (turn < 15)).any()
    mm, direction, _ = pairs(splits.train.anatomy_T_camera, splits.published.anatomy_T_camera)
    assert ((mm < 1.01) & (direction < 15)).any(axis=1).all()


def test_published_test_positions_lie_between_training_positions(splits) -> None:
    """On either side, 1 mm or less away on the same trajectory, there is a training position and no test position."""
    assert not set(splits.train.position) & set(splits.published.position)
    where = {
        int(p): (int(t), x)
        for views in (splits.train, splits.published)
        for p, t, x in zip(views.position, views.trajectory, views.anatomy_T_camera.position_mm, strict=True)
    }
    trained = set(splits.train.position.tolist())
    for position in set(splits.published.position.tolist()):
        trajectory, place = where[position]
        for beside in (position - 1, position + 1):
            assert beside in trained
            assert where[beside][0] == trajectory
            assert np.linalg.norm(where[beside][1] - place) < 1.01


def test_trajectory_test_views_are_on_trajectories_of_their_own(splits) -> None:
    assert not set(splits.train.trajectory) & set(splits.trajectory.trajectory)
    assert set(splits.published.trajectory) <= set(splits.train.trajectory)
    assert len(set(splits.trajectory.trajectory)) > 1
    assert np.array_equal(splits.trajectory_texture.anatomy_T_camera.matrix, splits.trajectory.anatomy_T_camera.matrix)


def test_cameras_are_in_the_lumen(splits) -> None:
    distance = signed_distance(winding_tube())
    for views in (splits.train, splits.published, splits.trajectory):
        check_in_lumen(distance, views.anatomy_T_camera, 0.85)


def test_every_position_has_something_to_see(splits) -> None:
    scene, deep = Scene(winding_tube()), Steering(median_depth_mm=15.0)
    for views in (splits.train, splits.published, splits.trajectory):
        assert sees_ahead(scene, views.anatomy_T_camera, 2.7).all()  # 3 mm but for the jitter
    deeper = make_splits(winding_tube(), SLABS, np.random.default_rng(0), SIZES, deep)
    assert sees_ahead(scene, deeper.train.anatomy_T_camera, 14.0).all()
    assert not sees_ahead(scene, splits.train.anatomy_T_camera, 14.0).all()


def test_the_same_seed_gives_the_same_splits(splits) -> None:
    again = make_splits(winding_tube(), SLABS, np.random.default_rng(0), SIZES)
    assert np.array_equal(again.train.anatomy_T_camera.matrix, splits.train.anatomy_T_camera.matrix)
    assert np.array_equal(again.trajectory.anatomy_T_camera.matrix, splits.trajectory.anatomy_T_camera.matrix)
    other = make_splits(winding_tube(), SLABS, np.random.default_rng(1), SIZES)
    assert not np.array_equal(other.train.anatomy_T_camera.matrix, splits.train.anatomy_T_camera.matrix)


def test_no_trajectory_test_pass_gives_two_positions_of_a_region(splits) -> None:
    """Positions in a row are near-copies: twenty of them from four passes would tell as little as four."""
    many = make_splits(winding_tube(), SLABS, np.random.default_rng(0), replace(SIZES, test_positions=20))
    for views in (splits.trajectory, many.trajectory):
        first = np.unique(views.position, return_index=True)[1]
        pairs_seen = list(zip(views.trajectory[first].tolist(), views.region[first].tolist(), strict=True))
        assert len(set(pairs_seen)) == len(pairs_seen)
    assert len(set(many.trajectory.trajectory.tolist())) >= 5


def test_trajectory_test_views_do_not_depend_on_how_much_is_trained(splits) -> None:
    """So they lie where a camera goes, not where the training leaves gaps."""
    little = make_splits(winding_tube(), SLABS, np.random.default_rng(0), replace(SIZES, train_positions=40))
    assert np.array_equal(little.trajectory.anatomy_T_camera.matrix, splits.trajectory.anatomy_T_camera.matrix)


def test_a_neighbour_is_near_in_both() -> None:
    up, ahead = np.array([0, 0, 1.0]), np.array([0, 1.0, 0])
    train = Pose.look(np.zeros((1, 3)), ahead[None], up, "LPS")

    def view(mm: float, deg: float, roll_deg: float = 0.0) -> Pose:
        way = np.array([np.sin(np.deg2rad(deg)), np.cos(np.deg2rad(deg)), 0])
        return Pose.look(np.array([[mm, 0, 0.0]]), way[None], up, "LPS", np.deg2rad(roll_deg))

    assert neighbours(train, view(1.9, 14)).all()
    assert not neighbours(train, view(2.1, 0)).any()
    assert not neighbours(train, view(0, 16)).any()
    assert neighbours(train, view(0, 0, 90)).all(), "a roll does not make a new view"
    with pytest.raises(DatasetError, match="1 of 1"):
        check_no_neighbours(train, view(1.9, 14))
    with pytest.raises(PoseError, match="'mean'"):
        neighbours(train, Pose(train.matrix, "mean", "camera"))


def test_a_region_off_every_passage_is_reached_by_a_passage_of_its_own() -> None:
    """The passage covers the first half of the tube only; the fourth slab still gets its share."""
    tube = winding_tube()
    main = tube.passages[0]
    half = replace(main, points_mm=main.points_mm[:80], clearance_mm=main.clearance_mm[:80])
    splits = make_splits(tube.with_(passages=(half,)), SLABS, np.random.default_rng(0), SIZES)
    assert (np.bincount(splits.train.region, minlength=4) > 0).all()
    assert (np.bincount(splits.trajectory.region, minlength=4) > 0).all()


def test_a_region_without_room_is_refused() -> None:
    far = SlabRegions("far", ("lumen", "beyond"), "LPS", 1, (90.0,))
    with pytest.raises(RegionError, match="beyond"):
        make_splits(winding_tube(), far, np.random.default_rng(0), SIZES)


@pytest.mark.slow
def test_a_lumen_that_the_test_sees_all_of_is_refused() -> None:
    crowded, always_the_same = SplitSizes(20, 320, 1), Steering(aim_sd_deg=0.1, side_mm=0.01)
    with pytest.raises(RegionError, match="allowed in this split"):
        make_splits(winding_tube(), SLABS, np.random.default_rng(0), crowded, always_the_same)


@pytest.mark.slow
def test_the_published_sizes_on_the_mean_nose(mean_nose_ply) -> None:
    from naris.anatomy.read import read_surface

    anatomy = read_surface(mean_nose_ply)
    regions = anatomy.region_set("paper")
    splits = make_splits(anatomy, regions, np.random.default_rng(0))
    assert (len(splits.train), len(splits.published), len(splits.trajectory)) == (1270, 150, 150)
    for views, least in ((splits.train, 250), (splits.published, 20), (splits.trajectory, 20)):
        assert np.bincount(views.region, minlength=4).min() >= least
        check_in_lumen(signed_distance(anatomy), views.anatomy_T_camera, 0.85)
        np.testing.assert_allclose(views.anatomy_T_camera.rotation[:, 2, 0], 0, atol=1e-9)  # +z is up
    assert not neighbours(splits.train.anatomy_T_camera, splits.trajectory.anatomy_T_camera).any()
    assert neighbours(splits.train.anatomy_T_camera, splits.published.anatomy_T_camera).all()


@pytest.mark.slow
def test_thirteen_regions_of_the_built_in_nose() -> None:
    from naris.anatomy.builtin import built_in_nose

    anatomy = built_in_nose(resolution_mm=1.0)
    splits = make_splits(anatomy, anatomy.region_set("anatomical"), np.random.default_rng(0))
    assert (len(splits.train), len(splits.published), len(splits.trajectory)) == (1270, 150, 150)
    for views, least in ((splits.train, 70), (splits.published, 10), (splits.trajectory, 10)):
        assert np.bincount(views.region, minlength=13).min() >= least
        check_in_lumen(signed_distance(anatomy), views.anatomy_T_camera, 0.3)
    assert not neighbours(splits.train.anatomy_T_camera, splits.trajectory.anatomy_T_camera).any()
