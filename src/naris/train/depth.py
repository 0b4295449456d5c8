"""Training the depth network: views at will in many anatomies, each picture with the ranges that belong to it."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import torch
from jaxtyping import Float, Float32, UInt8

from naris.core.camera import Intrinsics
from naris.core.progress import SILENT, Progress
from naris.core.provenance import Stopwatch, digest, plain
from naris.dataset.stream import Scopes, ViewStream
from naris.errors import CheckpointError
from naris.model.checkpoint import Tensors, read_tensors, write_tensors
from naris.model.depth import DepthConfig, DepthNetwork, depth_loss
from naris.model.localizer import limited
from naris.model.residual import PATCH
from naris.render.appearance import AppearanceDistribution
from naris.render.scene import render
from naris.render.viewpoints import draw_views
from naris.train.augment import Augmentation, augment
from naris.train.config import Adam, Muon, Replay
from naris.train.learner import cycle, resolved
from naris.train.optimiser import Optimiser

STATE = "depth-state.safetensors"
_SCHEMA = "naris.depth-training-state/1"
_NETWORK, _AVERAGE, _OPTIMISER, _HISTORY = "network.", "average.", "optimiser.", "history"
_CHANGE, _RECALL = 2, 3
_AHEAD = 2

OTHER_LIGHT = Augmentation(gain=0.15, tint=0.05, grey=0.5, gamma=0.25, shade=0.15, mottle=0.06, noise=5.0, blur=0.8)
"""Changes that leave the geometry as it is, for scopes and processors that nobody told of."""


@dataclass(frozen=True)
class DepthTraining:
    """How the depth network is trained.

    Attributes:
        network: its shape.
        steps: batches.
        batch: pictures in one.
        seed: of everything.
        adam, muon: the optimisers, of the head and norms and of what lies between.
        average: decay a step of the running average of the weights that is kept.
        scopes: vertical angles of the cameras.
        augmentation: of the pictures, without turns and zooms.
        replay: how often a rendered view is shown.
        edges: weight of the differences between neighbours.
        state_every_s: seconds between the states that a killed run goes on from.
    """

    network: DepthConfig = DepthConfig()
    steps: int = 7500
    batch: int = 64
    seed: int = 0
    adam: Adam = Adam(learning_rate=3e-3, weight_decay=0.02, decoupled=True, cycle=True)
    muon: Muon | None = Muon()
    average: float = 0.998
    scopes: Scopes = Scopes(vertical_fov_deg=(40.0, 95.0))
    augmentation: Augmentation = OTHER_LIGHT
    replay: Replay = Replay(times=3, memory=128)
    edges: float = 0.5
    state_every_s: float = 60.0


@dataclass(frozen=True, eq=False)
class DepthLesson:
    """B pictures with their truth.

    Attributes:
        images: (B, s, s, 3) uint8.
        half_height: (B,) tangents of half the vertical angles.
        log_range: (B, s / 4, s / 4) of the ranges (mm) through each patch, their median; NaN where there is no wall.
    """

    images: UInt8[np.ndarray, "b s s 3"]
    half_height: Float32[np.ndarray, "b"]
    log_range: Float32[np.ndarray, "b i j"]


class DepthLessons:
    """From streams over several anatomies, whose places and looks are used; lesson `step` depends on `step` alone."""

    def __init__(self, parts: Sequence[ViewStream], config: DepthTraining) -> None:
        self.parts, self.config = parts, config
        self._known: dict[int, DepthLesson] = {}

    @property
    def identity(self) -> str:
        """Tells these data from others."""
        told = [[part.anatomy.digest, plain(part.bank.distribution), plain(part.appearance)] for part in self.parts]
        return digest([told, plain(asdict(replace(self.config, state_every_s=60.0)))])

    def lesson(self, step: int) -> DepthLesson:
        config = self.config
        newest = step // config.replay.times
        oldest = max(newest - config.replay.memory + 1, 0)
        for index in [index for index in self._known if index < oldest]:
            del self._known[index]
        rng = np.random.default_rng([config.seed, _RECALL, step])
        which, row = rng.integers(oldest, newest + 1, config.batch), rng.integers(0, config.batch, config.batch)
        batches = {index: self._batch(index) for index in sorted(set(which.tolist()))}
        pick = [(batches[index], r) for index, r in zip(which.tolist(), row.tolist(), strict=True)]
        images = np.stack([batch.images[r] for batch, r in pick])
        half_height = np.stack([batch.half_height[r] for batch, r in pick])
        fov_deg = np.rad2deg(2 * np.arctan(half_height.astype(np.float64)))
        rng = np.random.default_rng([config.seed, _CHANGE, step])
        images, _ = augment(images, fov_deg, config.network.input_px, config.augmentation, rng)
        return DepthLesson(images, half_height, np.stack([batch.log_range[r] for batch, r in pick]))

    def _batch(self, index: int) -> DepthLesson:
        if index not in self._known:
            self._known[index] = drawn_lesson(self.parts[index % len(self.parts)], self.config, index)
        return self._known[index]


def drawn_lesson(part: ViewStream, config: DepthTraining, index: int) -> DepthLesson:
    """A batch of views with their ranges, as they were rendered.

    Raises:
        RegionError: if a region has no view that the distribution allows.
    """
    rng = np.random.default_rng([config.seed, index])
    size, edge = config.batch, config.network.input_px
    views = draw_views(part.scene, part.bank, size, rng)
    seeds = rng.integers(2**31, size=size)
    images = np.empty((size, edge, edge, 3), np.uint8)
    half_height = np.empty(size, np.float32)
    log_range = np.empty((size, edge // PATCH, edge // PATCH), np.float32)
    plain_camera = Intrinsics.from_vertical_fov(edge, edge, 60.0)
    for start in range(0, size, config.scopes.group):
        some = slice(start, min(start + config.scopes.group, size))
        camera = config.scopes.draw(plain_camera, rng)
        looks = [
            part.appearance.sample(rng) if isinstance(part.appearance, AppearanceDistribution) else part.appearance
            for _ in range(size)[some]
        ]
        made = render(
            part.scene,
            views.anatomy_T_camera[some],
            camera,
            looks,
            want=("rgb", "depth"),
            seeds=seeds[some],
            threads=part.threads,
        )
        images[some] = cast(np.ndarray, made.rgb)
        half_height[some] = edge / 2 / camera.fy
        log_range[some] = cell_log_ranges(cast(np.ndarray, made.depth_mm), camera)
    return DepthLesson(images, half_height, log_range)


def cell_log_ranges(depth_mm: Float[np.ndarray, "b s s"], camera: Intrinsics) -> Float32[np.ndarray, "b i j"]:
    """The logarithm of the median range through each patch of 4×4 pixels; NaN where there is none.

    Args:
        depth_mm: z-depth, 0 where there is no wall.
        camera: of all of them.
    """
    ranges = np.where(depth_mm > 0, depth_mm / camera.rays()[..., 2], np.nan)
    n, height, width = ranges.shape
    cut = ranges.reshape(n, height // PATCH, PATCH, width // PATCH, PATCH).swapaxes(2, 3)
    flat = cut.reshape(n, height // PATCH, width // PATCH, PATCH**2)
    known = np.asarray(np.isfinite(flat).all(axis=-1))
    return np.log(np.where(known, np.median(np.where(known[..., None], flat, 1.0), axis=-1), np.nan)).astype(np.float32)


@dataclass(frozen=True, eq=False)
class DepthRun:
    """What a training came to: weights, the loss of each step, pictures shown, seconds."""

    weights: Tensors
    losses: Float32[np.ndarray, "s"]
    pictures: int
    wall_s: float
    cpu_s: float


def train_depth(
    lessons: DepthLessons, out: Path, *, start: Tensors | None = None, progress: Progress = SILENT
) -> DepthRun:
    """Train, or go on from the state in the folder `out`; Ctrl-C waits for the end of a step and writes the state.

    Args:
        lessons: with the configuration.
        out: for the state.
        start: weights of a compact network, whose encoder to begin with.
        progress: told of every step.

    Raises:
        CheckpointError: if the state is damaged or of another training.
        DiskFull: if there is no room.
    """
    training = _Training.begun(lessons, out, start)
    config = lessons.config
    with limited(1), Stopwatch() as watch, progress.task("depth network", config.steps) as advance:
        advance(training.steps)
        stop, before = threading.Event(), None
        if threading.current_thread() is threading.main_thread():
            before = signal.signal(signal.SIGINT, lambda number, frame: stop.set())
        try:
            training.learn(watch, stop, advance)
        finally:
            if before is not None:
                signal.signal(signal.SIGINT, before)
    return DepthRun(
        training.kept(),
        np.array(training.history, np.float32),
        training.steps * config.batch,
        training.wall_s + watch.wall_s,
        training.cpu_s + watch.cpu_s,
    )


class _Training:
    """A network that learns, and its state."""

    def __init__(self, lessons: DepthLessons, out: Path, start: Tensors | None) -> None:
        self.lessons, self.config, self.out = lessons, lessons.config, out
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(self.config.seed)
            self.network = DepthNetwork(self.config.network)
        self.precision = resolved("auto")
        if start is not None:
            self.network.begin_with({name: torch.from_numpy(np.array(value)) for name, value in start.items()})
        self.network.to(memory_format=torch.channels_last)  # type: ignore[call-overload]
        self.optimiser = Optimiser(self.network, self.config, self.precision)
        self.average = [value.clone() for value in self._numbers()]
        self.history: list[float] = []
        self.wall_s = self.cpu_s = 0.0

    @classmethod
    def begun(cls, lessons: DepthLessons, out: Path, start: Tensors | None) -> _Training:
        """At its first step, or where the state says."""
        made = cls(lessons, out, start)
        if (out / STATE).is_file():
            made._restore(*read_tensors(out / STATE, _SCHEMA, "a training's state", f"remove {out} to start anew"))
        return made

    @property
    def steps(self) -> int:
        return len(self.history)

    def learn(self, watch: Stopwatch, stop: threading.Event, advance: Any) -> None:
        """All steps that are left."""
        config, saved_s = self.config, time.monotonic()
        coming: list[Future[DepthLesson]] = []
        with ThreadPoolExecutor(1, thread_name_prefix="lessons") as pool:
            number = self.steps
            while self.steps < config.steps:
                while len(coming) <= _AHEAD:
                    coming.append(pool.submit(self.lessons.lesson, number))
                    number += 1
                self._step(coming.pop(0).result())
                advance(1)
                if stop.is_set() or time.monotonic() - saved_s > config.state_every_s:
                    self._save(watch)
                    saved_s = time.monotonic()
                if stop.is_set():
                    pool.shutdown(wait=True, cancel_futures=True)
                    raise KeyboardInterrupt
            pool.shutdown(wait=True, cancel_futures=True)
        self._save(watch)

    def kept(self) -> Tensors:
        """The running average, by name."""
        state = self.network.state_dict()
        names = [name for name, value in state.items() if value.is_floating_point()]
        return {name: value.contiguous().numpy() for name, value in zip(names, self.average, strict=True)}

    def _step(self, lesson: DepthLesson) -> None:
        self.network.train()
        with torch.autocast("cpu", torch.bfloat16, enabled=self.precision == "bfloat16"):
            output = self.network(torch.from_numpy(lesson.images), torch.from_numpy(lesson.half_height))
        loss = depth_loss(output, torch.from_numpy(lesson.log_range), edges=self.config.edges)
        loss.backward()  # type: ignore[no-untyped-call]
        self.optimiser.step(cycle(self.steps / self.config.steps))
        self.history.append(float(loss.detach()))
        decay = min(self.config.average, self.steps / (self.steps + 20))
        with torch.no_grad():
            torch._foreach_lerp_(self.average, self._numbers(), 1 - decay)

    def _numbers(self) -> list[torch.Tensor]:
        return [value for value in self.network.state_dict().values() if value.is_floating_point()]

    def _save(self, watch: Stopwatch) -> None:
        tensors = {_NETWORK + name: value.contiguous().numpy() for name, value in self.network.state_dict().items()}
        tensors |= {f"{_AVERAGE}{i}": value.contiguous().numpy() for i, value in enumerate(self.average)}
        tensors |= {_OPTIMISER + name: value for name, value in self.optimiser.state().items()}
        tensors[_HISTORY] = np.array(self.history, np.float32)
        about = {"of": self.lessons.identity, "wall_s": self.wall_s + watch.wall_s, "cpu_s": self.cpu_s + watch.cpu_s}
        self.out.mkdir(parents=True, exist_ok=True)
        write_tensors(self.out / STATE, _SCHEMA, about, tensors)

    def _restore(self, about: dict[str, Any], tensors: Tensors) -> None:
        if about.get("of") != self.lessons.identity:
            raise CheckpointError("the state of this training", "that of another", f"remove {self.out} to start anew")
        of_network, of_optimiser = _under(_NETWORK, tensors), _under(_OPTIMISER, tensors)
        self.network.load_state_dict({name: torch.from_numpy(value.copy()) for name, value in of_network.items()})
        self.optimiser.restore(of_optimiser)
        for i, mean in enumerate(self.average):
            mean.copy_(torch.from_numpy(np.array(tensors[f"{_AVERAGE}{i}"])))
        self.history = tensors[_HISTORY].tolist()
        self.wall_s, self.cpu_s = float(about["wall_s"]), float(about["cpu_s"])


def _under(prefix: str, tensors: Tensors) -> Tensors:
    return {name.removeprefix(prefix): value for name, value in tensors.items() if name.startswith(prefix)}
