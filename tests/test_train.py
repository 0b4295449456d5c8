"""Training: it learns, it is the same after a kill, and it refuses what was changed."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation
from scipy.special import softmax

from naris.core.anatomy import Anatomy, SlabRegions
from naris.core.camera import Intrinsics
from naris.core.pose import Pose
from naris.dataset.layout import RegionLabels
from naris.dataset.stream import Batch
from naris.errors import CheckpointError, ConfigurationChanged, DatasetError, InputError, RegionError
from naris.locate import views_of
from naris.model.checkpoint import Subject, load_checkpoint
from naris.model.compact import CompactConfig
from naris.model.localizer import fitted, open_localizer
from naris.model.standing import region_shares
from naris.model.two_layer import TwoLayerConfig
from naris.train import COMPACT_AT_WILL, COMPACT_FEW, PUBLISHED, Examples, Replay, TrainConfig, train, train_runs
from naris.train.augment import FEW_PICTURES, Augmentation, augment
from naris.train.data import FixedLessons, Lesson, StreamLessons, split_off
from naris.train.learner import rate
from naris.train.loop import MODEL, STATE
from naris.train.strangers import strangers

SLABS = SlabRegions("paper", ("a", "b", "c"), "mean", 1, (-10.0, 10.0))
INTRINSICS = Intrinsics.from_vertical_fov(24, 24, 45.0)
TINY = CompactConfig(input_px=16, channels=(8, 16), blocks=(1, 1), reduced=4, embedding=12, hypotheses=2)
QUICK = COMPACT_FEW.lasting(epochs=3).with_(network=TINY, batch=16, precision="float32", threads=1)
TWO_LAYER = PUBLISHED.lasting(epochs=2).with_(network=TwoLayerConfig(24), batch=8, threads=1)


def _views(n: int, seed: int) -> Batch:
    """Pictures of a bar whose place tells y, and whose tint tells nothing."""
    rng = np.random.default_rng(seed)
    place = rng.uniform([-5, -30, -5], [5, 30, 5], (n, 3))
    images = rng.integers(0, 40, (n, 24, 24, 3), dtype=np.uint8)
    column = np.round((place[:, 1] + 30) / 60 * 20).astype(int)
    for picture, start in zip(images, column, strict=True):
        picture[:, start : start + 4] = rng.integers(150, 255, 3)
    turned = Rotation.from_rotvec(rng.normal(0, 0.1, (n, 3))).as_matrix()
    return Batch(images, SLABS.label(place), Pose.of(turned, place, "mean", "camera"), np.full(n, 45.0))


def _examples(n: int = 48) -> Examples:
    views = _views(n, 0)
    subject = Subject(RegionLabels.of(SLABS), "bar", "0" * 64, "mean", INTRINSICS)
    return Examples(views.images, views.region, views.anatomy_T_camera, subject, np.arange(n) // 8)


class _BarStream:
    """A stream of such views, that counts what it is asked for."""

    intrinsics = INTRINSICS
    regions = SLABS
    seed = 5

    def __init__(self) -> None:
        corners = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
        faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], dtype=np.int32)
        self.anatomy = Anatomy(corners, faces, "mean", "bar", "test")
        self.asked: list[int] = []
        self.avoid: Pose | None = None

    def batch(self, index: int, size: int) -> Batch:
        self.asked.append(index)
        return _views(size, 1000 + index)

    def steered(self, positions: int, per_position: int) -> Batch:
        return _views(positions * per_position, 999)


class _Stop:
    """Progress that interrupts after some steps, as Ctrl-C would."""

    def __init__(self, after: int) -> None:
        self.left = after

    @contextmanager
    def task(self, name: str, total: int) -> Iterator[object]:
        def advance(steps: int) -> None:
            self.left -= steps
            if self.left == 0:
                os.kill(os.getpid(), signal.SIGINT)

        yield advance


class _Count:
    """Progress that remembers its tasks."""

    def __init__(self) -> None:
        self.seen: dict[str, list[int]] = {}

    @contextmanager
    def task(self, name: str, total: int) -> Iterator[object]:
        self.seen[name] = [total, 0]

        def advance(steps: int) -> None:
            self.seen[name][1] += steps

        yield advance


def _same_weights(a: Path, b: Path) -> bool:
    ours, theirs = load_checkpoint(a).weights, load_checkpoint(b).weights
    return all(np.array_equal(ours[name], theirs[name]) for name in ours)


@pytest.mark.parametrize("config", [QUICK, TWO_LAYER])
def test_an_interrupted_training_ends_with_the_same_weights(tmp_path: Path, config: TrainConfig) -> None:
    whole = train(_examples(), config, tmp_path / "whole")
    for after in (2, 3):
        with pytest.raises(KeyboardInterrupt):
            train(_examples(), config, tmp_path / "parts", progress=_Stop(after))
        assert (tmp_path / "parts" / STATE).is_file()
    parts = train(_examples(), config, tmp_path / "parts")
    assert _same_weights(whole.checkpoint, parts.checkpoint)
    assert np.array_equal(whole.losses, parts.losses)
    assert (whole.pictures, whole.steps) == (parts.pictures, parts.steps)
    assert not (tmp_path / "parts" / STATE).exists()


def test_a_killed_training_goes_on_with_the_same_weights(tmp_path: Path) -> None:
    config = TWO_LAYER.lasting(epochs=10)
    whole = train(_examples(), config, tmp_path / "whole")
    often = config.with_(state_every_s=0.0)
    child = multiprocessing.get_context("spawn").Process(target=train, args=(_examples(), often, tmp_path / "parts"))
    child.start()
    deadline = time.monotonic() + 120
    while not (tmp_path / "parts" / STATE).is_file() and time.monotonic() < deadline:
        time.sleep(0.005)
    child.kill()
    child.join()
    assert not (tmp_path / "parts" / "run.json").exists()
    assert _same_weights(whole.checkpoint, train(_examples(), config, tmp_path / "parts").checkpoint)


def test_a_stream_goes_on_with_the_same_weights(tmp_path: Path) -> None:
    config = COMPACT_AT_WILL.lasting(steps=10).with_(
        network=TINY, batch=8, precision="float32", threads=1, replay=Replay(2, 3)
    )
    whole = train(_BarStream(), config, tmp_path / "whole")
    with pytest.raises(KeyboardInterrupt):
        train(_BarStream(), config, tmp_path / "parts", progress=_Stop(5))
    parts = train(_BarStream(), config, tmp_path / "parts")
    assert _same_weights(whole.checkpoint, parts.checkpoint)


def test_short_trainings_have_a_curve_too(tmp_path: Path) -> None:
    """Where a budget or a number of steps ends it, an epoch may be longer than all of it."""
    config = COMPACT_AT_WILL.with_(network=TINY, batch=8, precision="float32", threads=1, replay=Replay(2, 3))
    assert train(_BarStream(), config.lasting(steps=41), tmp_path / "steps").loss.shape == (21,)
    assert train(_examples(), QUICK.lasting(steps=9), tmp_path / "few").loss.shape == (9,)
    assert train(_examples(), QUICK.lasting(epochs=2), tmp_path / "epochs").loss.shape == (2,)


def test_what_the_poses_say_counts_in_what_a_model_says_of_regions(tmp_path: Path) -> None:
    """Against the pool made by hand from the parts."""
    config = COMPACT_AT_WILL.lasting(steps=60).with_(
        network=TINY, batch=16, precision="float32", threads=1, replay=Replay(2, 3)
    )
    checkpoint = load_checkpoint(train(_BarStream(), config, tmp_path).checkpoint)
    calibration = checkpoint.calibration
    assert checkpoint.subject.borders == SLABS
    assert calibration.power > 0
    localizer, images = open_localizer(checkpoint), _BarStream().batch(7, 12).images
    said = localizer.outputs(images)
    shares = region_shares(SLABS, said.poses, said.weights, said.covariance)
    p = softmax(said.logits.astype(np.float64) / calibration.temperature, axis=1) * shares**calibration.power
    p /= p.sum(axis=1, keepdims=True)
    strange = np.minimum(calibration.usual.out_of_domain(said.embedding, said.domain_logit), 0.99)[:, None]
    expected = (1 - strange) * p + strange / p.shape[1]
    assert np.allclose([one.probabilities for one in localizer.predict(images)], expected, atol=1e-9)
    told = checkpoint.training
    assert told["start"] is None
    assert told["data"]["kind"] == "views at will"


def test_a_second_call_does_nothing_and_tells_the_same(tmp_path: Path) -> None:
    first = train(_examples(), TWO_LAYER, tmp_path)
    stamp = first.checkpoint.stat().st_mtime_ns
    again = train(_examples(), TWO_LAYER, tmp_path, progress=_Stop(1))
    assert first.checkpoint.stat().st_mtime_ns == stamp
    assert np.allclose(first.losses, again.losses, rtol=1e-5)
    assert first.loss.shape == (2,)


def test_changed_settings_or_data_are_refused_and_nothing_is_touched(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        train(_examples(), TWO_LAYER, tmp_path, progress=_Stop(3))
    before = (tmp_path / STATE).read_bytes()
    other = _examples()
    other.images[0, 0, 0, 0] ^= 1
    for data, config in ((_examples(), TWO_LAYER.with_(seed=1)), (other, TWO_LAYER)):
        with pytest.raises(ConfigurationChanged, match="use another folder"):
            train(data, config, tmp_path)
    assert (tmp_path / STATE).read_bytes() == before
    train(_examples(), TWO_LAYER.with_(threads=2), tmp_path)
    with pytest.raises(ConfigurationChanged):
        train(_examples(), TWO_LAYER.with_(seed=1), tmp_path)


def test_a_folder_of_somebody_else_is_refused_and_nothing_is_touched(tmp_path: Path) -> None:
    model = tmp_path / "mine" / "model.safetensors"
    model.parent.mkdir()
    model.write_bytes(b"weights of a long training")
    with pytest.raises(
        InputError, match=r"a new or empty folder.* got one with model\.safetensors; use another folder"
    ):
        train(_examples(), TWO_LAYER, model.parent)
    assert [path.name for path in model.parent.iterdir()] == [model.name]
    assert model.read_bytes() == b"weights of a long training"
    with pytest.raises(InputError, match="got a file"):
        train(_examples(), TWO_LAYER, model)
    # What a system or a killed run leaves, unseen, keeps nobody from training.
    (tmp_path / "new").mkdir()
    (tmp_path / "new" / ".state.12ab.part.safetensors").touch()
    assert train(_examples(), TWO_LAYER.lasting(epochs=1), tmp_path / "new").steps == 6


def test_a_truncated_state_is_told(tmp_path: Path) -> None:
    with pytest.raises(KeyboardInterrupt):
        train(_examples(), TWO_LAYER, tmp_path, progress=_Stop(2))
    content = (tmp_path / STATE).read_bytes()
    (tmp_path / STATE).write_bytes(content[: len(content) // 2])
    with pytest.raises(CheckpointError, match="training's state"):
        train(_examples(), TWO_LAYER, tmp_path)


def test_the_two_layer_training_is_torchs_adam_on_raw_pixels(tmp_path: Path) -> None:
    """The loop against the few lines that the published code would have."""
    examples = _examples()
    run = train(examples, TWO_LAYER.lasting(epochs=1), tmp_path)
    torch.manual_seed(TWO_LAYER.seed)
    from naris.model.two_layer import TwoLayer

    network = TwoLayer(3, TwoLayerConfig(24), fused=False)
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-3, weight_decay=1e-3)
    lessons = FixedLessons(examples, TWO_LAYER)
    for step in range(lessons.per_epoch):
        lesson = lessons.lesson(step)
        raw = torch.from_numpy(lesson.images.transpose(0, 3, 1, 2).astype(np.float32))
        loss = torch.nn.functional.cross_entropy(network(raw), torch.from_numpy(lesson.region.astype(np.int64)))
        assert float(loss.detach()) == pytest.approx(float(run.losses[step, 0]), rel=1e-3)
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()


def test_it_learns_and_finds_regions_of_new_pictures(tmp_path: Path) -> None:
    gentle = Augmentation(gain=0.2, noise=4.0)
    config = QUICK.lasting(epochs=30).with_(augmentation=gentle, batch=32)
    run = train(_examples(320), config, tmp_path)
    assert run.loss[-1] < 0.7 * run.loss[0]
    new = _views(200, 77)
    localizer = open_localizer(run.checkpoint, regions=SLABS)
    predictions = localizer.predict(new.images)
    assert np.mean([p.region == truth for p, truth in zip(predictions, new.region, strict=True)]) > 0.75
    off_mm = [
        abs(p.hypotheses.position_mm[0, 1] - y)
        for p, y in zip(predictions, new.anatomy_T_camera.position_mm[:, 1], strict=True)
    ]
    assert np.median(off_mm) < 8


def test_a_training_starts_from_given_weights(tmp_path: Path) -> None:
    first = train(_examples(), QUICK.lasting(epochs=40), tmp_path / "a")
    start = load_checkpoint(first.checkpoint)
    again = train(_examples(), QUICK.lasting(epochs=1), tmp_path / "b", start=start)
    fresh = train(_examples(), QUICK.lasting(epochs=1), tmp_path / "c")
    assert again.losses[0, 1] < 0.7 * fresh.losses[0, 1]
    kept = load_checkpoint(again.checkpoint).weights
    assert np.array_equal(kept["position_mean_mm"], start.weights["position_mean_mm"])


def test_a_training_from_given_weights_is_taken_up_again_and_told_from_others(tmp_path: Path) -> None:
    start = load_checkpoint(train(_examples(), QUICK, tmp_path / "start").checkpoint)
    with pytest.raises(KeyboardInterrupt):
        train(_examples(), QUICK, tmp_path / "a", start=start, progress=_Stop(4))
    with pytest.raises(ConfigurationChanged):
        train(_examples(), QUICK, tmp_path / "a")
    train(_examples(), QUICK, tmp_path / "a", start=start)
    train(_examples(), QUICK, tmp_path / "b", start=start)
    assert _same_weights(tmp_path / "a" / MODEL, tmp_path / "b" / MODEL)


def test_frozen_layers_stay_as_they_began(tmp_path: Path) -> None:
    """Their norms' running means as well; the layers behind them learn, and go on after a stop as without one."""
    start = load_checkpoint(train(_examples(), QUICK, tmp_path / "start").checkpoint)
    config = QUICK.with_(frozen=2)
    with pytest.raises(KeyboardInterrupt):
        train(_examples(), config, tmp_path / "a", start=start, progress=_Stop(4))
    for folder in ("a", "b"):
        train(_examples(), config, tmp_path / folder, start=start)
    assert _same_weights(tmp_path / "a" / MODEL, tmp_path / "b" / MODEL)
    weights = load_checkpoint(tmp_path / "a" / MODEL).weights
    still = {name for name, value in weights.items() if np.array_equal(value, start.weights[name])}
    first = {name for name in weights if name.startswith(("stem.", "stages.0."))}
    assert first <= still
    assert not {name for name in still - first if name.startswith("stages.1.")}
    with pytest.raises(InputError, match="weights to start from"):
        train(_examples(), config, tmp_path / "c")
    for layers, of in ((-1, QUICK), (4, QUICK), (1, TWO_LAYER)):
        with pytest.raises(InputError, match="frozen layers"):
            of.with_(frozen=layers)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"config": QUICK.with_(network=replace(TINY, embedding=16))}, "configuration"),
        ({"config": TWO_LAYER}, "network"),
        ({"names": ("a", "b", "d")}, "regions"),
        ({"frame": "LPS"}, "frame"),
    ],
)
def test_weights_that_do_not_fit_are_no_start(tmp_path: Path, changes: dict[str, Any], says: str) -> None:
    start = load_checkpoint(train(_examples(), QUICK.lasting(epochs=1), tmp_path / "start").checkpoint)
    subject = start.subject
    regions = replace(subject.regions, names=changes.get("names", subject.regions.names))
    start = replace(start, subject=replace(subject, regions=regions, frame=changes.get("frame", subject.frame)))
    with pytest.raises(CheckpointError, match=f"a model to start from with the {says}"):
        train(_examples(), changes.get("config", QUICK), tmp_path / "a", start=start)
    assert not (tmp_path / "a").exists()


def test_epochs_show_every_picture_once() -> None:
    examples = _examples(50)
    lessons = FixedLessons(examples, TWO_LAYER)
    assert lessons.per_epoch == 7
    orders = []
    for epoch in range(2):
        shown = [lessons.lesson(epoch * 7 + i).pose[:, :3, 3] for i in range(7)]
        orders.append(np.concatenate(shown))
    for order in orders:
        assert np.array_equal(np.sort(order, axis=0), np.sort(examples.anatomy_T_camera.position_mm, axis=0))
    assert not np.array_equal(*orders)


@pytest.mark.parametrize(("n", "sizes"), [(50, [16, 16, 16, 2]), (33, [16, 17]), (17, [17]), (2, [2]), (16, [16])])
def test_no_lesson_has_a_picture_alone(n: int, sizes: list[int]) -> None:
    config = QUICK.with_(batch=16)
    lessons = FixedLessons(_examples(n), config)
    shown = [lessons.lesson(i) for i in range(lessons.per_epoch)]
    assert [len(lesson.region) for lesson in shown] == sizes
    places = np.concatenate([lesson.pose[:, :3, 3] for lesson in shown])
    assert len(np.unique(places, axis=0)) == n


def test_the_published_epoch_is_64_lessons_the_last_of_10() -> None:
    lessons = FixedLessons(_examples(1270), PUBLISHED.with_(network=TwoLayerConfig(24)))
    assert lessons.per_epoch == 64
    assert [len(lessons.lesson(i).region) for i in (0, 62, 63, 64)] == [20, 20, 10, 20]


def test_a_set_that_leaves_one_picture_over_is_learned_from(tmp_path: Path) -> None:
    run = train(_examples(17), QUICK.lasting(epochs=2), tmp_path)
    assert (run.steps, run.pictures) == (2, 34)
    with pytest.raises(DatasetError, match="at least 2 pictures"):
        train(_examples(1), QUICK, tmp_path / "one")


@pytest.mark.parametrize(("width", "height"), [(40, 24), (24, 40), (24, 24)])
def test_training_and_locating_see_the_same_square(width: int, height: int) -> None:
    """The middle of the picture, never squeezed, with the rays that the checkpoint's camera says."""
    camera = Intrinsics.from_vertical_fov(width, height, 45.0)
    rng = np.random.default_rng(0)
    images = cv2.GaussianBlur(rng.integers(30, 255, (height, width, 36)).astype(np.float32), (0, 0), 2.0)
    images = images.astype(np.uint8).reshape(height, width, 12, 3).transpose(2, 0, 1, 3).copy()
    examples = _examples(12)
    examples = replace(examples, images=images, subject=replace(examples.subject, intrinsics=camera))
    expected = fitted(images, 16)
    (order,) = [np.random.default_rng([0, 1, 0]).permutation(12)]
    for augmentation in (None, Augmentation()):
        config = QUICK.with_(batch=12, augmentation=augmentation, strangers=0.0)
        lessons = FixedLessons(examples, config)
        off = lessons.lesson(0).images.astype(int) - expected[order]
        assert np.abs(off).max() <= (0 if augmentation is None else 14)
    made_for = lessons.subject.intrinsics
    assert (made_for.width, made_for.height) == (24, 24)
    assert (made_for.fx, made_for.fy) == (camera.fx, camera.fy)
    for image, square in zip(images, expected, strict=True):
        (plain,) = views_of(image, 16, made_for)
        assert np.array_equal(plain, square)
        (matched,) = views_of(image, 16, made_for, camera)
        assert np.abs(matched.astype(int) - square)[1:-1, 1:-1].mean() < 2  # at the edge black shines in


@pytest.mark.parametrize(("width", "height", "aspect"), [(96, 64, 1.0), (64, 96, 1.0), (64, 64, 1.2)])
def test_a_turned_camera_of_any_shape_sees_the_same_directions(width: int, height: int, aspect: float) -> None:
    """A bright dot in a picture or of pixels that are not square is where the checkpoint's camera says."""
    camera = Intrinsics.from_vertical_fov(width, height, 45.0)
    camera = replace(camera, fx=camera.fy * aspect)
    images = np.zeros((20, height, width, 3), np.uint8)
    column, row = width // 2 + 9, height // 2 - 7
    images[:, row - 1 : row + 2, column - 1 : column + 2] = 255
    examples = _examples(20)
    examples = replace(examples, images=images, subject=replace(examples.subject, intrinsics=camera))
    only_turn = Augmentation(turn_deg=3.0, roll_deg=20.0)
    config = QUICK.with_(batch=20, augmentation=only_turn, strangers=0.0, network=replace(TINY, input_px=48))
    lessons = FixedLessons(examples, config)
    lesson = lessons.lesson(0)
    order = np.random.default_rng([0, 1, 0]).permutation(20)
    turn = np.swapaxes(examples.anatomy_T_camera.matrix[order, :3, :3], 1, 2) @ lesson.pose[:, :3, :3]
    small, direction = lessons.subject.intrinsics.resized(48, 48), camera.unproject(np.array([column, row], float))
    for picture, rotation in zip(lesson.images, turn, strict=True):
        (pixel,), _ = small.project((direction @ rotation)[None])
        weight = picture[..., 0].astype(float)
        v, u = np.mgrid[0:48, 0:48]
        found = np.array([(u * weight).sum(), (v * weight).sum()]) / weight.sum()
        assert np.linalg.norm(found - pixel) < 0.7


def test_a_stream_of_tall_pictures_is_seen_through_its_middle() -> None:
    stream = _BarStream()
    stream.intrinsics = Intrinsics.from_vertical_fov(24, 40, 60.0)
    tall = _views(8, 1)
    images = np.pad(tall.images, ((0, 0), (8, 8), (0, 0), (0, 0)))
    stream.batch = lambda index, size: replace(tall, images=images, vertical_fov_deg=np.full(8, 60.0))  # type: ignore[method-assign]
    config = COMPACT_AT_WILL.lasting(steps=1).with_(network=TINY, batch=8, replay=None, strangers=0.0)
    lessons = StreamLessons(stream, config.with_(augmentation=None))
    assert np.array_equal(lessons.lesson(0).images, fitted(tall.images, 16))
    made_for = lessons.subject.intrinsics
    assert (made_for.width, made_for.height, made_for.fy) == (24, 24, stream.intrinsics.fy)
    # The very changes of a stream of square pictures through that camera.
    changed = StreamLessons(stream, config).lesson(0)
    square = _BarStream()
    square.intrinsics = made_for
    square.batch = lambda index, size: replace(tall, vertical_fov_deg=np.full(8, made_for.vertical_fov_deg))  # type: ignore[method-assign]
    assert np.abs(StreamLessons(square, config).lesson(0).images.astype(int) - changed.images).max() <= 1


def test_what_a_model_remembers_of_a_stream_tells_others_from_runs_of_one() -> None:
    """Another seed of the views is another run; another look or camera is another experiment."""

    def told(**settings: object) -> object:
        stream = _BarStream()
        for name, value in settings.items():
            setattr(stream, name, value)
        return StreamLessons(stream, COMPACT_AT_WILL.with_(network=TINY, batch=8)).told["source"]

    assert told(seed=0) == told(seed=1)
    wide = Intrinsics.from_vertical_fov(16, 16, 80.0)
    assert len({told(), told(appearance="paper"), told(intrinsics=wide), told(steered_share=0.5)}) == 4


def test_no_view_is_turned_to_be_near_one_that_stays_unseen() -> None:
    """Cameras look 16° past an unseen view; turned by 10° or so, some would come nearer than 15°."""
    stream = _BarStream()
    views = _views(8, 1)
    forward = np.stack([np.zeros(8), np.cos(np.deg2rad(16)) * np.ones(8), np.sin(np.deg2rad(16)) * np.ones(8)], axis=1)
    poses = Pose.look(np.zeros((8, 3)), forward, np.array([0, 0, 1.0]), "mean")
    stream.batch = lambda index, size: replace(views, anatomy_T_camera=poses)  # type: ignore[method-assign]
    turning = Augmentation(turn_deg=10.0, gain=0.3)
    config = COMPACT_AT_WILL.lasting(steps=1).with_(
        network=TINY, batch=8, replay=None, strangers=0.0, augmentation=turning
    )

    def lesson(avoid: Pose | None) -> Lesson:
        stream.avoid = avoid
        return StreamLessons(stream, config).lesson(0)

    unseen = Pose.look(np.zeros((1, 3)), np.array([[0, 1.0, 0]]), np.array([0, 0, 1.0]), "mean")
    free, kept = lesson(None), lesson(unseen)
    angle = [np.rad2deg(np.arccos(made.pose[:, 1, 2])) for made in (free, kept)]
    near = angle[0] < 15
    assert 0 < near.sum() < 8
    np.testing.assert_allclose(angle[1][near], 16, atol=1e-6)
    assert np.array_equal(kept.pose[~near], free.pose[~near])
    assert np.array_equal(kept.images[~near], free.images[~near])
    assert not np.array_equal(kept.images[near], free.images[near])


def test_temperature_and_power_are_those_of_a_steered_camera(tmp_path: Path) -> None:
    """Of the steered views all labels are wrong, so the network's word counts for little; without them it counts."""

    class Wrong(_BarStream):
        def steered(self, positions: int, per_position: int) -> Batch:
            views = _views(positions * per_position, 999)
            return replace(views, region=(views.region + 1) % 3)

    class None_(_BarStream):
        def steered(self, positions: int, per_position: int) -> Batch:
            raise RegionError("a way", "none", "widen it")

    config = COMPACT_AT_WILL.lasting(steps=40).with_(network=TINY, batch=16, precision="float32", threads=1)
    wrong, without = (
        load_checkpoint(train(stream, config, tmp_path / name).checkpoint).calibration
        for name, stream in (("wrong", Wrong()), ("without", None_()))
    )
    assert wrong.temperature > 2 * without.temperature


def test_a_stream_is_rendered_once_and_forgotten() -> None:
    stream = _BarStream()
    config = COMPACT_AT_WILL.lasting(steps=60).with_(network=TINY, batch=8, replay=Replay(times=3, memory=4))
    lessons = StreamLessons(stream, config)
    for step in range(60):
        assert lessons.lesson(step).images.shape == (8, 16, 16, 3)
    assert sorted(stream.asked) == list(range(20))
    jumped = StreamLessons(_BarStream(), config).lesson(41)
    again = StreamLessons(_BarStream(), config)
    assert np.array_equal([again.lesson(s) for s in range(42)][-1].images, jumped.images)


def test_trajectories_are_kept_apart_whole() -> None:
    examples = _examples(80)
    learned, kept = split_off(examples, 0.2, seed=0)
    assert len(learned) + len(kept) == 80
    assert len(kept) == 16
    assert not set(learned.group) & set(kept.group)
    assert split_off(examples, 0.0, 0)[1] is None


def test_validation_sets_the_temperature(tmp_path: Path) -> None:
    config = QUICK.lasting(epochs=1).with_(validation_share=0.5)
    checkpoint = load_checkpoint(train(_examples(320), config, tmp_path / "kept").checkpoint)
    assert checkpoint.calibration.pictures == 160
    plain = load_checkpoint(train(_examples(), TWO_LAYER, tmp_path / "plain").checkpoint)
    assert (plain.calibration.pictures, plain.calibration.temperature, plain.calibration.usual) == (0, 1.0, None)


def test_a_budget_is_kept_and_the_rate_falls_with_the_clock(tmp_path: Path) -> None:
    progress = _Count()
    config = QUICK.lasting(budget_s=1.0).with_(batch=8)
    run = train(_examples(), config, tmp_path, progress=progress)
    assert 1.0 <= run.wall_s < 10.0
    assert progress.seen["train"][0] == progress.seen["train"][1]
    rates = [rate(config, done) for done in (0.0, 1 / 6, 0.5, 1.0)]
    assert rates[1] == max(rates) == 1
    assert rates[3] < 0.01 * rates[1] < rates[0]
    assert rate(PUBLISHED, 0.9) == 1


@pytest.mark.long
def test_runs_side_by_side_are_those_one_after_the_other(tmp_path: Path) -> None:
    progress = _Count()
    one = train_runs(_examples(), TWO_LAYER, [0, 1], tmp_path / "one", workers=1)
    two = train_runs(_examples(), TWO_LAYER, [0, 1], tmp_path / "two", workers=2, progress=progress)
    for ours, theirs in zip(one, two, strict=True):
        assert ours.seed == theirs.seed
        assert _same_weights(ours.checkpoint, theirs.checkpoint)
    assert not np.array_equal(one[0].losses, one[1].losses)
    assert progress.seen == {"seed 0": [12, 12], "seed 1": [12, 12]}
    assert {path.name for path in (tmp_path / "two").iterdir()} == {"seed-0", "seed-1"}


def test_training_off_the_main_thread_leaves_signals_alone(tmp_path: Path) -> None:
    before = signal.getsignal(signal.SIGINT)
    worker = threading.Thread(target=train, args=(_examples(), TWO_LAYER, tmp_path))
    worker.start()
    worker.join()
    assert (tmp_path / "run.json").is_file()
    assert signal.getsignal(signal.SIGINT) is before


def test_bad_settings_and_data_are_told() -> None:
    with pytest.raises(InputError, match="one of epochs, steps and budget_s"):
        QUICK.lasting(epochs=3, steps=5)
    with pytest.raises(InputError, match="one of epochs, steps and budget_s"):
        QUICK.lasting()
    examples = _examples()
    with pytest.raises(DatasetError, match="as many labels"):
        replace(examples, anatomy_T_camera=examples.anatomy_T_camera[:-1])
    with pytest.raises(DatasetError, match="lie in no region"):
        replace(examples, region=examples.region - 1)


def test_a_turned_camera_sees_the_same_directions() -> None:
    """A bright dot is found where the turned camera's intrinsics say."""
    big = Intrinsics.from_vertical_fov(96, 96, 45.0)
    rng = np.random.default_rng(0)
    images = np.zeros((20, 96, 96, 3), np.uint8)
    images[:, 40:43, 55:58] = 255
    only_turn = Augmentation(turn_deg=4.0, roll_deg=8.0)
    changed, turn = augment(images, np.full(20, 45.0), 64, only_turn, rng)
    direction = big.unproject(np.array([56.0, 41.0]))
    small = big.resized(64, 64)
    for picture, rotation in zip(changed, turn, strict=True):
        pixel, inside = small.project((direction @ rotation)[None])
        if not inside[0]:
            continue
        weight = picture[..., 0].astype(float)
        v, u = np.mgrid[0:64, 0:64]
        found = np.array([(u * weight).sum(), (v * weight).sum()]) / weight.sum()
        assert np.linalg.norm(found - pixel[0]) < 0.7


def test_no_augmentation_is_the_identity_and_all_of_it_is_repeatable() -> None:
    views = _views(6, 3)
    fov = np.full(6, 45.0)
    same, turn = augment(views.images, fov, 24, Augmentation(), np.random.default_rng(0))
    assert np.array_equal(same, views.images)
    assert np.allclose(turn, np.eye(3))
    twice = [augment(views.images, fov, 16, FEW_PICTURES, np.random.default_rng(4))[0] for _ in range(2)]
    assert np.array_equal(*twice)


def test_strangers_are_varied_and_repeatable() -> None:
    familiar = _views(4, 0).images
    first, again = (strangers(40, 24, familiar, np.random.default_rng(2)) for _ in range(2))
    assert np.array_equal(first, again)
    assert len(np.unique(first.reshape(40, -1), axis=0)) == 40
