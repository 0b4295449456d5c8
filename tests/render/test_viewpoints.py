"""Views are drawn as their distribution says, and cameras outside the lumen are refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from naris.anatomy.distance import signed_distance
from naris.core.anatomy import SlabRegions
from naris.core.camera import Intrinsics
from naris.core.pose import Pose
from naris.errors import InputError, PoseError, RegionError
from naris.render.appearance import PAPER
from naris.render.directions import Bearings, aims, bearings, tangents, tilted, upright
from naris.render.scene import Scene, render
from naris.render.viewpoints import (
    ANYWHERE,
    FREE,
    INSPECTION,
    TRAVEL,
    ViewDistribution,
    _even_chances,
    check_in_lumen,
    draw_views,
    joined,
    passages_of,
    sees_ahead,
    view_bank,
)
from tests.winding_tube import RADIUS_MM, SLABS, centre_line, widening_tube, winding_tube


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(winding_tube())


@pytest.fixture(scope="module")
def distance():
    return signed_distance(winding_tube())


@cache
def bank_of(distance, distribution: ViewDistribution, regions: SlabRegions = SLABS):
    return view_bank(distance, winding_tube().passages, regions, distribution)


def angles_deg(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.rad2deg(np.arccos(np.clip((a * b).sum(axis=-1), -1, 1)))


def test_each_region_comes_equally_often_and_the_labels_are_those_of_the_cameras(scene, distance) -> None:
    views = draw_views(scene, bank_of(distance, INSPECTION), 42, np.random.default_rng(1))
    assert sorted(np.bincount(views.region).tolist()) == [10, 10, 11, 11]
    assert (views.region == SLABS.label(views.anatomy_T_camera.position_mm)).all()
    assert len(set(views.region[:10].tolist())) > 1, "the order is random"
    assert (views.trajectory == FREE).all()
    assert (views.position == FREE).all()


def test_the_same_seed_gives_the_same_views(scene, distance) -> None:
    bank = bank_of(distance, INSPECTION)
    one, two, other = (draw_views(scene, bank, 30, np.random.default_rng(s)).anatomy_T_camera for s in (5, 5, 6))
    assert np.array_equal(one.matrix, two.matrix)
    assert not np.array_equal(one.matrix, other.matrix)


def test_inspection_looks_along_the_passage(scene, distance) -> None:
    """Against the tube's own centre line: two thirds within 15°, none beyond the largest tilt, all rolls about 12°."""
    bank = bank_of(distance, replace(INSPECTION, median_depth_mm=0.0))
    poses = draw_views(scene, bank, 4000, np.random.default_rng(0)).anatomy_T_camera
    passage = winding_tube().passages
    tilt = angles_deg(poses.forward, bearings(poses.position_mm, distance, passage).way)
    assert 0.62 < (tilt < 15).mean() < 0.72
    assert tilt.max() < INSPECTION.tilt_max_deg + 3  # the direction is that of the nearest node
    level = Pose.look(poses.position_mm, poses.forward, upright(poses.forward), "LPS")
    roll = angles_deg(poses.rotation[:, :, 1], level.rotation[:, :, 1])
    assert 11 < np.sqrt((roll**2).mean()) < 13


def test_anywhere_is_uniform_in_its_cone(scene, distance) -> None:
    """In a cone of solid angle the share within half the angle is (1 − cos(θ/2)) / (1 − cos θ)."""
    poses = draw_views(scene, bank_of(distance, ANYWHERE), 4000, np.random.default_rng(0)).anatomy_T_camera
    tilt = angles_deg(poses.forward, bearings(poses.position_mm, distance, winding_tube().passages).way)
    expected = (1 - np.cos(np.deg2rad(12.5))) / (1 - np.cos(np.deg2rad(25)))
    assert abs((tilt < 12.5).mean() - expected) < 0.03


@pytest.mark.parametrize("distribution", [INSPECTION, ANYWHERE], ids=lambda d: d.name)
def test_cameras_keep_the_clearance(scene, distance, distribution) -> None:
    """Against the distance to the centre line that the tube was made from."""
    poses = draw_views(scene, bank_of(distance, distribution), 500, np.random.default_rng(3)).anatomy_T_camera
    off = np.linalg.norm(poses.position_mm[:, None] - centre_line()[None], axis=-1).min(axis=1)
    assert off.max() < RADIUS_MM - distribution.clearance_mm + 0.15
    assert off.max() > RADIUS_MM - distribution.clearance_mm - 0.5, "and use the room up to it"


def test_inspection_has_depth_ahead(scene, distance) -> None:
    """Rendered anew at another size; the probe of the draw has 8×8 pixels."""
    deep = replace(INSPECTION, median_depth_mm=8.0, tilt_sd_deg=25.0, tilt_max_deg=80.0)
    camera = Intrinsics.from_vertical_fov(48, 48, 45.0)

    def medians(distribution: ViewDistribution) -> np.ndarray:
        poses = draw_views(scene, bank_of(distance, distribution), 200, np.random.default_rng(0)).anatomy_T_camera
        depth = render(scene, poses, camera, PAPER, want=("depth",)).depth_mm
        return np.median(depth.reshape(len(poses), -1), axis=1)

    assert (medians(deep) > 7.5).mean() > 0.97
    assert (medians(replace(deep, median_depth_mm=0.0)) < 7.5).mean() > 0.1, "without the check they are not deep"


def test_a_view_into_the_void_is_no_view(scene) -> None:
    """From inside all is wall; from outside, past the tube's flank, about half; away from it, nothing."""
    up, side = np.array([0, 0, 1.0]), np.array([[1.0, 0, 0]])
    inside = Pose.look(centre_line()[[80]], -np.roll(side, 1), up, "LPS")
    flank = Pose.look(np.array([[-20.0, 0, RADIUS_MM]]), side, up, "LPS")
    away = Pose.look(np.array([[-20.0, 0, 0]]), -side, up, "LPS")
    three = Pose(np.concatenate([inside.matrix, flank.matrix, away.matrix]), "LPS", "camera")
    assert sees_ahead(scene, three, 0.0).tolist() == [True, True, True]
    assert sees_ahead(scene, three, 0.0, seen=0.1).tolist() == [True, True, False]
    assert sees_ahead(scene, three, 0.0, seen=0.8).tolist() == [True, False, False]
    assert sees_ahead(scene, three, 1.0).tolist()[2] is False


def test_a_depth_that_no_view_has_is_refused_by_region(scene, distance) -> None:
    bank = bank_of(distance, replace(INSPECTION, median_depth_mm=70.0))
    with pytest.raises(RegionError, match="median depth"):
        draw_views(scene, bank, 8, np.random.default_rng(0))


def test_a_region_that_is_too_narrow_gives_its_widest_places(scene, distance) -> None:
    """The tip of the tube has no place 2 mm off the wall, but it has places."""
    tip = SlabRegions("tip", ("tip", "rest"), "LPS", 1, (-43.6,))
    bank = bank_of(distance, replace(INSPECTION, clearance_mm=2.0, median_depth_mm=0.0), tip)
    assert 0 < bank.room_mm[0] < 2.0
    assert bank.room_mm[1] == 2.0
    views = draw_views(scene, bank, 40, np.random.default_rng(0))
    assert np.bincount(views.region).tolist() == [20, 20]
    check_in_lumen(distance, views.anatomy_T_camera)


def test_a_region_outside_the_lumen_is_refused(distance) -> None:
    beyond = SlabRegions("far", ("all", "beyond"), "LPS", 1, (100.0,))
    with pytest.raises(RegionError, match="beyond"):
        bank_of(distance, INSPECTION, beyond)


def test_no_passage_or_another_frame_is_refused(distance) -> None:
    with pytest.raises(RegionError, match="passages"):
        view_bank(distance, (), SLABS, INSPECTION)
    with pytest.raises(RegionError, match="mean"):
        view_bank(distance, winding_tube().passages, replace(SLABS, frame="mean"), INSPECTION)


def test_a_camera_outside_the_lumen_is_refused_with_its_place(distance) -> None:
    inside, outside = centre_line()[40], np.array([0.0, 0.0, 60.0])
    ahead = np.array([[0, 1.0, 0]] * 2)
    poses = Pose.look(np.stack([inside, outside]), ahead, np.array([0, 0, 1.0]), "LPS")
    check_in_lumen(distance, poses[:1], clearance_mm=4.0)
    with pytest.raises(PoseError, match=r"number 1\) at \(0\.0, 0\.0, 60\.0\) mm, .* outside"):
        check_in_lumen(distance, poses)
    with pytest.raises(PoseError, match=r"7\.0 mm from its wall"):
        check_in_lumen(distance, poses[:1], clearance_mm=7.0)
    with pytest.raises(PoseError, match="'mean'"):
        check_in_lumen(distance, Pose(poses.matrix, "mean", "camera"))


@given(st.integers(0, 2**32 - 1))
def test_upright_is_the_shortest_turn(seed) -> None:
    """It is a unit vector across the direction, and no other turn of +y to the direction is smaller."""
    forward = np.random.default_rng(seed).normal(0, 1, (20, 3))
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    up = upright(forward)
    near_pole = forward[:, 1] < -0.999
    np.testing.assert_allclose((up * forward).sum(axis=1)[~near_pole], 0, atol=1e-9)
    np.testing.assert_allclose(np.linalg.norm(up, axis=1)[~near_pole], 1, atol=1e-9)
    turn = np.stack([np.cross(forward, up), forward, up], axis=-1)
    angle = np.arccos(np.clip((np.trace(turn, axis1=1, axis2=2) - 1) / 2, -1, 1))
    np.testing.assert_allclose(angle[~near_pole], np.arccos(forward[:, 1])[~near_pole], atol=1e-6)


def test_upright_is_plus_z_at_the_horizontal_and_has_no_pole_there() -> None:
    level = np.array([[0, 1.0, 0], [1.0, 0, 0], [0.6, 0.8, 0]])
    np.testing.assert_allclose(upright(level), [[0, 0, 1]] * 3, atol=1e-12)
    np.testing.assert_allclose(upright(np.array([0, 0, 1.0])), [0, -1, 0], atol=1e-12)


@given(st.floats(0, 3), st.integers(0, 1000))
def test_tilted_turns_by_the_angle(tilt, seed) -> None:
    rng = np.random.default_rng(seed)
    way = rng.normal(0, 1, (5, 3))
    way /= np.linalg.norm(way, axis=1, keepdims=True)
    turned = tilted(way, np.full(5, tilt), rng)
    np.testing.assert_allclose(np.arccos(np.clip((way * turned).sum(axis=1), -1, 1)), tilt, atol=1e-6)


def test_tangents_are_those_of_the_curve() -> None:
    line = centre_line()
    exact = np.gradient(line, axis=0)
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    found = tangents(winding_tube().passages[0])
    assert angles_deg(found, exact)[20:-20].max() < 3


def test_travelling_takes_every_stretch_of_the_way_equally_often(scene, distance) -> None:
    """Along a winding tube of one width: none is left out and none crowded, whatever the bends do to the grid."""
    one = SlabRegions("one", ("all",), "LPS", 1, ())
    views = draw_views(scene, bank_of(distance, TRAVEL, one), 3000, np.random.default_rng(2))
    line = winding_tube().passages[0].points_mm
    way_mm = 0.5 * np.argmin(np.linalg.norm(views.anatomy_T_camera.position_mm[:, None] - line, axis=2), axis=1)
    middle = way_mm[(way_mm > 15) & (way_mm < 66)]
    counts = np.histogram(middle, bins=17, range=(15, 66))[0]
    assert counts.min() > 0.6 * counts.mean()
    assert counts.max() < 1.5 * counts.mean()


def test_travelling_takes_a_narrow_stretch_as_often_as_a_wide_one() -> None:
    """The wide end of a widening tube has twenty times the room for a camera of the narrow one."""
    tube = widening_tube()
    one = SlabRegions("one", ("all",), "LPS", 1, ())
    bank = view_bank(signed_distance(tube, 0.8), tube.passages, one, replace(TRAVEL, median_depth_mm=0.0, seen=0.0))
    y = draw_views(Scene(tube), bank, 3000, np.random.default_rng(2)).anatomy_T_camera.position_mm[:, 1]
    counts = np.histogram(y, bins=12, range=(-36, 36))[0]
    assert counts.min() > 0.75 * counts.mean()
    assert counts.max() < 1.25 * counts.mean()


def test_places_of_one_stretch_share_its_chance() -> None:
    region = np.array([0, 0, 0, 0, 1, 1, 1])
    chance = np.diff(_even_chances(region, _beside([0.1, 0.2, 0.3, 5.0, 5.5, 7.0, 11.0], [0] * 7)))
    np.testing.assert_allclose(chance, [2 / 9, 2 / 9, 2 / 9, 1 / 3, 1 / 5, 2 / 5, 2 / 5])


def test_passages_beside_each_other_are_travelled_equally_often() -> None:
    """At the same depth a roomy passage of three places and a narrow one of a single place have chances alike."""
    chance = np.diff(_even_chances(np.zeros(4, int), _beside([4.0, 4.5, 5.0, 4.2], [0, 0, 0, 1])))
    np.testing.assert_allclose(chance, [1 / 6, 1 / 6, 1 / 6, 1 / 2])


def _beside(depth_mm: list[float], passage: list[int]) -> Bearings:
    nowhere = np.zeros((len(passage), 3))
    return Bearings(np.array(passage), nowhere, nowhere, np.array(depth_mm))


def test_a_camera_beside_the_passage_is_aimed_back_to_it(distance) -> None:
    way = np.array([[0.0, 1.0, 0.0]])
    np.testing.assert_allclose(aims(way, np.array([[0.0, 0.0, -4.0]]), 10.0)[0, 2], -2 / np.sqrt(104))
    bank = bank_of(distance, replace(TRAVEL, tilt_sd_deg=0.0))
    found = bearings(bank.places_mm, distance, winding_tube().passages)
    back = found.goal_mm - bank.places_mm
    beside = np.linalg.norm(back, axis=1) > 2
    turned = ((bank.tangents - found.way) * back).sum(axis=1)[beside]
    assert (turned > 0).all()


def test_a_place_takes_the_passage_that_it_sees(distance) -> None:
    """A passage behind the wall is nearer but out of sight."""
    from naris.core.anatomy import Passage

    main = winding_tube().passages[0]
    near_wall = main.points_mm + [0, 0, RADIUS_MM - 0.7]
    behind = Passage("behind", (near_wall + [0, 0, 1.2])[::-1], np.zeros(len(near_wall)))
    some = near_wall[20:120]
    found = bearings(some, distance, (behind, main))
    assert (found.passage == 1).all()
    assert (found.way[:, 1] > 0).all()
    index = np.argmin(np.linalg.norm(some[:, None] - main.points_mm, axis=2), axis=1)
    np.testing.assert_allclose(found.goal_mm, main.points_mm[index])
    np.testing.assert_allclose(found.depth_mm, 0.5 * index, rtol=0.01)  # the points of the passage are 0.5 mm apart
    assert (bearings(some, distance, (behind,)).way[:, 1] < 0).all()


def test_an_anatomy_without_passages_gets_some(distance) -> None:
    bare = winding_tube().with_(passages=())
    assert passages_of(winding_tube(), distance) == winding_tube().passages
    assert passages_of(bare, distance)[0].length_mm > 60


def test_joined_keeps_the_order_and_refuses_mixed_frames(scene, distance) -> None:
    views = draw_views(scene, bank_of(distance, ANYWHERE), 6, np.random.default_rng(0))
    both = joined([views[:2], views[2:]])
    assert np.array_equal(both.anatomy_T_camera.matrix, views.anatomy_T_camera.matrix)
    moved = replace(views, anatomy_T_camera=Pose(views.anatomy_T_camera.matrix, "mean", "camera"))
    with pytest.raises(PoseError, match="several frames"):
        joined([views, moved])


def test_a_distribution_of_impossible_numbers_is_refused() -> None:
    with pytest.raises(InputError, match="largest tilt"):
        replace(INSPECTION, tilt_max_deg=0.0)
    with pytest.raises(InputError, match="from 0 up"):
        replace(INSPECTION, clearance_mm=-1.0)
