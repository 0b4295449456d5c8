"""Batches by number: the same bits, whoever asks, whenever."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from naris.core.camera import Intrinsics
from naris.core.pose import Pose
from naris.dataset.pilot import Pilot
from naris.dataset.stream import MANY_SCOPES, Scopes, SeveralStreams, ViewStream, view_stream
from naris.errors import InputError
from naris.render.appearance import PAPER, TRAINING_APPEARANCE
from naris.render.keyframes import UP
from naris.render.near import neighbours
from naris.render.scene import Scene, render
from naris.render.viewpoints import INSPECTION, Viewpoints, draw_views
from tests.winding_tube import SLABS, winding_tube

CAMERA = Intrinsics.from_vertical_fov(32, 32, 45.0)


@pytest.fixture(scope="module")
def stream():
    return view_stream(Scene(winding_tube()), SLABS, INSPECTION, TRAINING_APPEARANCE, CAMERA, seed=3)


def same(one, other) -> bool:
    return all(
        np.array_equal(a, b)
        for a, b in (
            (one.images, other.images),
            (one.region, other.region),
            (one.anatomy_T_camera.matrix, other.anatomy_T_camera.matrix),
            (one.vertical_fov_deg, other.vertical_fov_deg),
        )
    )


def test_a_batch_depends_on_seed_and_number_alone(stream) -> None:
    first = stream.batch(5, 12)
    stream.batch(2, 12)
    assert same(first, stream.batch(5, 12))
    assert same(first, replace(stream, threads=1).batch(5, 12))
    fresh = view_stream(Scene(winding_tube()), SLABS, INSPECTION, TRAINING_APPEARANCE, CAMERA, seed=3)
    assert same(first, fresh.batch(5, 12))
    assert not same(first, stream.batch(6, 12))
    assert not same(first, replace(stream, seed=4).batch(5, 12))


def test_batches_ahead_are_those_of_one_by_one_in_order(stream) -> None:
    ahead = list(stream.batches(range(3, 9), 8, ahead=3))
    assert len(ahead) == 6
    assert all(same(batch, stream.batch(3 + i, 8)) for i, batch in enumerate(ahead))


def from_the_bank(stream: ViewStream, rng: np.random.Generator) -> Viewpoints:
    return draw_views(stream.scene, stream.bank, 3000, rng, stream.avoid)


def steered(stream: ViewStream, rng: np.random.Generator) -> Viewpoints:
    return Pilot.in_(stream.scene, stream.regions, 1).glimpses(600, rng, stream.avoid)


@pytest.mark.parametrize("many", [from_the_bank, pytest.param(steered, marks=pytest.mark.long)])
def test_views_keep_away_from_those_that_shall_stay_unseen(stream, many) -> None:
    """An unseen view in the middle of the tube: without the rule some views come near it, with it none."""
    line = winding_tube().passages[0].points_mm
    middle = len(line) // 2
    unseen = Pose.look(line[middle][None], (line[middle + 4] - line[middle])[None], np.array(UP), "LPS")

    def counts(chosen: ViewStream) -> tuple[int, int]:
        """Views that stand near the unseen one, and those of them that look the same way."""
        poses = many(chosen, np.random.default_rng(0)).anatomy_T_camera
        close = np.linalg.norm(poses.position_mm - unseen.position_mm, axis=1) < 2.0
        alike = poses.forward @ unseen.forward[0] > np.cos(np.deg2rad(15))
        return int(close.sum()), int((close & alike).sum())

    free, kept = counts(stream), counts(stream.away_from(unseen))
    assert free[1] > 0
    assert kept[1] == 0
    # As many stand there as before, looking elsewhere: a network must not learn that nobody ever does.
    assert kept[0] > 0.8 * free[0] > 8


def test_a_share_of_a_batch_is_steered(stream) -> None:
    """Regions equally often in either part, the same bits again, and nearer to the way than views from the bank."""
    line = winding_tube().passages[0].points_mm

    def off_mm(batch) -> float:
        return np.linalg.norm(batch.anatomy_T_camera.position_mm[:, None] - line, axis=-1).min(axis=1).mean()

    free, half, all_of_it = (stream.with_steered(share).batch(3, 64) for share in (0.0, 0.5, 1.0))
    assert same(free, stream.batch(3, 64))
    assert same(half, stream.with_steered(0.5).batch(3, 64))
    assert [np.bincount(batch.region).tolist() for batch in (free, half, all_of_it)] == [[16] * 4] * 3
    assert off_mm(all_of_it) < off_mm(half) < off_mm(free)
    with pytest.raises(InputError, match="one view or more"):
        Pilot.in_(stream.scene, stream.regions, 1).glimpses(0, np.random.default_rng(0))
    for wrong in (-0.1, 1.1, float("nan")):
        with pytest.raises(InputError, match="a share of steered views"):
            stream.with_steered(wrong)


def test_a_steered_camera_keeps_to_the_way_and_away_from_the_unseen(stream) -> None:
    seen = stream.steered(12, 3)
    assert same(seen, stream.steered(12, 3))
    assert np.bincount(seen.region).tolist() == [9, 9, 9, 9]
    assert (seen.region == SLABS.label(seen.anatomy_T_camera.position_mm)).all()
    line = winding_tube().passages[0].points_mm

    def off_mm(poses: Pose) -> float:
        return np.linalg.norm(poses.position_mm[:, None] - line, axis=-1).min(axis=1).mean()

    assert off_mm(seen.anatomy_T_camera) < 0.7 * off_mm(stream.batch(0, 64).anatomy_T_camera)
    unseen = seen.anatomy_T_camera[:3]
    assert neighbours(unseen, seen.anatomy_T_camera).sum() >= 3
    away = stream.away_from(unseen).steered(12, 3)
    assert not neighbours(unseen, away.anatomy_T_camera).any()
    assert np.bincount(away.region).tolist() == [9, 9, 9, 9]
    both = SeveralStreams((stream, replace(stream, seed=8))).steered(12, 3)
    assert len(both) == 2 * 6 * 3


def test_leaving_early_stops_the_thread(stream) -> None:
    batches = stream.batches(iter(range(1000000)), 4)
    assert same(next(batches), stream.batch(0, 4))
    batches.close()


def test_an_error_on_the_thread_reaches_the_caller(stream) -> None:
    with pytest.raises(ValueError, match="negative"):
        list(stream.batches([-1], 4))


def test_the_pictures_are_those_of_the_poses(stream) -> None:
    plain = replace(stream, appearance=PAPER)
    batch = plain.batch(0, 8)
    direct = render(stream.scene, batch.anatomy_T_camera, CAMERA, PAPER, want=("rgb",))
    assert np.array_equal(batch.images, direct.rgb)
    assert np.bincount(batch.region).tolist() == [2, 2, 2, 2]
    assert (batch.region == SLABS.label(batch.anatomy_T_camera.position_mm)).all()
    np.testing.assert_allclose(batch.vertical_fov_deg, 45.0)


def test_appearances_differ_from_view_to_view(stream) -> None:
    batch = stream.batch(0, 16)
    colours = batch.images.reshape(16, -1, 3).mean(axis=1)
    assert len(np.unique(colours.round(1), axis=0)) == 16


def test_many_scopes_have_their_own_fields_of_view(stream) -> None:
    """Groups of views share a camera within the asked range, and a wider one sees more of the same scene."""
    many = replace(stream, scopes=replace(MANY_SCOPES, group=4), appearance=PAPER)
    batch = many.batch(0, 24)
    fov = batch.vertical_fov_deg.reshape(6, 4)
    assert (fov == fov[:, :1]).all()
    assert len(np.unique(fov[:, 0])) == 6
    assert fov.min() >= 36
    assert fov.max() <= 78
    assert same(batch, many.batch(0, 24))


def test_a_scope_of_impossible_numbers_is_refused() -> None:
    for wrong in ({"vertical_fov_deg": (60.0, 50.0)}, {"vertical_fov_deg": (0.0, 50.0)}, {"shift": 0.7}, {"group": 0}):
        with pytest.raises(InputError, match="fields of view"):
            Scopes(**wrong)


def test_several_streams_take_turns(stream) -> None:
    other = replace(stream, seed=8)
    both = SeveralStreams((stream, other))
    assert same(both.batch(4, 8), stream.batch(4, 8))
    assert same(both.batch(5, 8), other.batch(5, 8))
    assert (both.anatomy.digest, both.regions.names) == (stream.anatomy.digest, stream.regions.names)


def test_streams_of_several_kinds_are_refused(stream) -> None:
    with pytest.raises(InputError, match="the same regions"):
        SeveralStreams((stream, replace(stream, intrinsics=Intrinsics.from_vertical_fov(32, 32, 60.0))))
    with pytest.raises(InputError, match="0 kinds"):
        SeveralStreams(())
