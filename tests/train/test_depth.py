"""Training the depth network: lessons that are true, a loss that falls, and an interruption that changes nothing."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from naris.core.camera import Intrinsics
from naris.dataset.stream import Scopes, ViewStream, view_stream
from naris.errors import CheckpointError
from naris.model.depth import DepthConfig
from naris.render.appearance import TRAINING_APPEARANCE
from naris.render.scene import Scene
from naris.render.viewpoints import INSPECTION
from naris.train import Replay
from naris.train.depth import STATE, DepthLessons, DepthTraining, cell_log_ranges, drawn_lesson, train_depth
from tests.winding_tube import SLABS, winding_tube

TINY = DepthTraining(
    network=DepthConfig(input_px=32, channels=(8, 16), back=(8,)),
    steps=12,
    batch=8,
    scopes=Scopes(vertical_fov_deg=(50.0, 80.0), group=4),
    replay=Replay(times=2, memory=4),
)


@pytest.fixture(scope="module")
def stream() -> ViewStream:
    camera = Intrinsics.from_vertical_fov(32, 32, 60.0)
    return view_stream(Scene(winding_tube()), SLABS, INSPECTION, TRAINING_APPEARANCE, camera, seed=3)


def test_ranges_of_a_plane_are_those_of_geometry() -> None:
    camera = Intrinsics.from_vertical_fov(16, 16, 60.0)
    depth = np.full((1, 16, 16), 7.0)
    expected = np.log(7.0 / camera.resized(4, 4).rays()[..., 2])
    np.testing.assert_allclose(
        cell_log_ranges(depth, camera)[0], expected, atol=0.01
    )  # the median is beside the middle


def test_a_cell_with_a_hole_is_not_known() -> None:
    camera = Intrinsics.from_vertical_fov(16, 16, 60.0)
    depth = np.full((1, 16, 16), 7.0)
    depth[0, 5, 6] = 0.0
    known = np.isfinite(cell_log_ranges(depth, camera)[0])
    assert not known[1, 1]
    assert known.sum() == 15


def test_a_lesson_depends_on_its_number_alone(stream: ViewStream) -> None:
    one, other = DepthLessons([stream], TINY), DepthLessons([stream], TINY)
    for step in range(4):
        one.lesson(step)
    first, again = one.lesson(5), other.lesson(5)
    np.testing.assert_array_equal(first.images, again.images)
    np.testing.assert_array_equal(first.log_range, again.log_range)
    assert not np.array_equal(first.images, one.lesson(6).images)


def test_walls_are_as_far_away_as_the_tube_is_wide(stream: ViewStream) -> None:
    lesson = drawn_lesson(stream, TINY, 0)
    assert lesson.images.shape == (8, 32, 32, 3)
    assert lesson.log_range.shape == (8, 8, 8)
    assert 1.0 < np.exp(np.nanmin(lesson.log_range)) < 8.0
    angles = np.rad2deg(2 * np.arctan(lesson.half_height))
    assert len(set(np.round(angles, 3))) == 2
    assert ((angles > 49) & (angles < 81)).all()


def test_the_loss_falls(stream: ViewStream, tmp_path: Path) -> None:
    run = train_depth(DepthLessons([stream], replace(TINY, steps=60)), tmp_path)
    assert np.median(run.losses[-10:]) < 0.6 * np.median(run.losses[:5])
    assert run.pictures == 60 * 8


class Stopping:
    """Progress that sends Ctrl-C after some steps."""

    def __init__(self, after: int) -> None:
        self.left = after

    @contextmanager
    def task(self, name: str, total: int) -> Iterator[Callable[[int], None]]:
        def advance(steps: int) -> None:
            self.left -= steps
            if self.left == 0:
                signal.raise_signal(signal.SIGINT)

        yield advance


def test_a_training_that_was_stopped_ends_with_the_same_weights(stream: ViewStream, tmp_path: Path) -> None:
    whole = train_depth(DepthLessons([stream], TINY), tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        train_depth(DepthLessons([stream], TINY), tmp_path / "parts", progress=Stopping(5))
    assert (tmp_path / "parts" / STATE).is_file()
    parts = train_depth(DepthLessons([stream], TINY), tmp_path / "parts")
    np.testing.assert_array_equal(whole.losses, parts.losses)
    for name, value in whole.weights.items():
        np.testing.assert_array_equal(value, parts.weights[name], err_msg=name)


def test_the_state_of_another_training_is_refused(stream: ViewStream, tmp_path: Path) -> None:
    train_depth(DepthLessons([stream], replace(TINY, steps=2)), tmp_path)
    with pytest.raises(CheckpointError, match="the state of this training"):
        train_depth(DepthLessons([stream], TINY), tmp_path)
