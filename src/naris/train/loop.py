"""Training from start to end, however often it is interrupted.

A training folder holds `state.safetensors` while it goes on (weights, optimiser, history: nothing that executes), and
in the end `model.safetensors` and `run.json`. Each file is there whole or not at all. The same call on the same folder
goes on from the state; on a finished one it does nothing. With `epochs` or `steps`, an interrupted training ends with
the very weights of one that was not, on the same machine with the same number of threads.
"""

from __future__ import annotations

import json
import logging
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Float32

from naris.core.atomic import write_json
from naris.core.progress import SILENT, Advance, Progress
from naris.core.provenance import Stopwatch, commit, versions
from naris.errors import CheckpointError, InputError
from naris.model.checkpoint import Checkpoint, read_tensors, save_checkpoint, write_tensors
from naris.model.localizer import limited
from naris.train.config import TrainConfig
from naris.train.data import Examples, Lessons, Stream, lessons_from, lessons_of, split_off
from naris.train.fit import calibrated
from naris.train.learner import PARTS, Learner, check_start, resolved_precision, start_told
from naris.train.origin import Origin

MODEL, RUN, STATE = "model.safetensors", "run.json", "state.safetensors"
_RUN_SCHEMA, _STATE_SCHEMA = "naris.training/1", "naris.training-state/1"
_HISTORY = "history"
_BUDGET_TICKS = 1000
_LEAST_POINTS = 20

_log = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class TrainingRun:
    """A finished training.

    Attributes:
        folder: where its files are.
        seed: of the run.
        losses: (S, P) parts of the loss (`naris.train.learner.PARTS`) at every step.
        per_epoch: steps in an epoch (where the training does not count epochs, those that are reported together).
        pictures: shown in all.
        wall_s, cpu_s: how long it took over all its parts; CPU over all threads.
        settings: the configuration as JSON.
    """

    folder: Path
    seed: int
    losses: Float32[np.ndarray, "s p"]
    per_epoch: int
    pictures: int
    wall_s: float
    cpu_s: float
    settings: dict[str, Any]

    @property
    def checkpoint(self) -> Path:
        return self.folder / MODEL

    @property
    def steps(self) -> int:
        return len(self.losses)

    @property
    def loss(self) -> Float[np.ndarray, "e"]:
        """The region loss (cross-entropy), mean over each epoch."""
        starts = np.arange(0, len(self.losses), self.per_epoch)
        sums = np.add.reduceat(self.losses[:, PARTS.index("region")].astype(np.float64), starts)
        return sums / np.diff(np.append(starts, len(self.losses)))


@dataclass
class _Journal:
    """What has been so far.

    The history is of plain numbers: a small array that stays from every step lies between the large ones that come
    and go, and the process grew by megabytes a step.
    """

    history: list[list[float]]
    by: str | None
    pictures: int = 0
    wall_s: float = 0.0
    cpu_s: float = 0.0


def train(
    data: Examples | Stream,
    config: TrainConfig,
    out: Path,
    *,
    start: Checkpoint | None = None,
    progress: Progress = SILENT,
    task: str = "train",
) -> TrainingRun:
    """Train a network, or go on where a training in the folder `out` was interrupted.

    Sets torch's number of threads (one for the whole process) meanwhile, to `config.torch_threads`. On the main thread
    Ctrl-C waits for the end of a step, writes the state and then raises KeyboardInterrupt.

    Args:
        data: a fixed set, or a stream.
        config: how.
        out: a folder that is new, empty, or holds this very training.
        start: a model of the same shape, for the same regions in the same frame, whose weights to begin with.
        progress: told of every step (of thousandths of a budget).
        task: its name there.

    Raises:
        ConfigurationChanged: if `out` holds a training with other settings or other data; nothing is touched.
        CheckpointError: if its state is damaged, or `start` does not fit.
        InputError: if `out` is a file, or a folder with other things in it; nothing is touched.
        DatasetError: if the data cannot be learned from.
        DiskFull: if there is no room; the state before stays.
    """
    kept = None
    if isinstance(data, Examples):
        data, kept = split_off(data, config.validation_share, config.seed)
    lessons = lessons_of(data, config)
    origin = Origin.of(config, lessons, start)
    if start is not None:
        check_start(start, config, lessons.subject)
    elif config.frozen:
        raise InputError("weights to start from", "none, and layers that stay as they begin", "give a start")
    if (out / RUN).is_file():
        origin.check(_record(out), out)
        run = read_run(out)
        _log.info("the training in %s was finished before: nothing to do", out)
        if (by := by_other_code(out)) is not None:
            _log.warning("the training in %s was made by other code, of commit %s", out, by)
        return run
    _check_free(out)
    with limited(config.torch_threads):
        learner, journal = _begin(lessons, config, out, origin, start)
        try:
            with Stopwatch() as watch, progress.task(task, _ticks(config, lessons)) as advance:
                _learn(_Loop(learner, lessons, journal, out, origin, advance), watch)
        finally:
            journal.wall_s, journal.cpu_s = journal.wall_s + watch.wall_s, journal.cpu_s + watch.cpu_s
        settings = origin.settings
        made = {"settings": settings, "steps": learner.steps, "precision": learner.precision, "versions": versions()}
        made |= {"data": lessons.told, "start": None if start is None else start_told(start)}
        save_checkpoint(out / MODEL, calibrated(learner.checkpoint(made), lessons, kept, journal.pictures))
    run = TrainingRun(
        out,
        config.seed,
        np.array(journal.history, dtype=np.float32),
        _reported_together(config, lessons, len(journal.history)),
        journal.pictures,
        journal.wall_s,
        journal.cpu_s,
        settings,
    )
    _write_run(run, origin, journal.by)
    (out / STATE).unlink(missing_ok=True)
    return run


def by_other_code(folder: Path) -> str | None:
    """The commit of the code that made a finished training (`naris.core.provenance.commit`), if it is not this code.

    None where it is. Code with changes that no commit has is never known to be the same.

    Raises:
        CheckpointError: as `read_run`.
    """
    by, here = _record(folder).get("commit"), commit()
    same = by == here and not (here or "").endswith("-dirty")
    return None if same else str(by or "unknown")


def read_run(folder: Path) -> TrainingRun:
    """A finished training as it was recorded.

    Raises:
        CheckpointError: if the folder holds none or its record is damaged.
    """
    content = _record(folder)
    try:
        return TrainingRun(
            folder,
            int(content["seed"]),
            np.array(content["losses"], dtype=np.float32).reshape(-1, len(PARTS)),
            int(content["per_epoch"]),
            int(content["pictures"]),
            float(content["wall_s"]),
            float(content["cpu_s"]),
            dict(content["settings"]),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise CheckpointError(f"a training's record in {folder / RUN}", f"one without {error}", "train anew") from error


@dataclass(frozen=True, eq=False)
class _Loop:
    """What the steps of a training work with."""

    learner: Learner
    lessons: Lessons
    journal: _Journal
    out: Path
    origin: Origin
    advance: Advance

    @property
    def config(self) -> TrainConfig:
        return self.learner.config

    def done(self, elapsed_s: float) -> float:
        """The share of the training that lies behind."""
        if self.config.budget_s is not None:
            return elapsed_s / self.config.budget_s
        return self.learner.steps / _steps(self.config, self.lessons)

    def save(self, watch: Stopwatch) -> None:
        """Write the state."""
        journal = self.journal
        about = {
            **self.origin.record(),
            "commit": journal.by,
            "steps": self.learner.steps,
            "precision": self.learner.precision,
            "pictures": journal.pictures,
            "wall_s": journal.wall_s + watch.wall_s,
            "cpu_s": journal.cpu_s + watch.cpu_s,
        }
        history = np.array(journal.history, dtype=np.float32).reshape(-1, len(PARTS))
        write_tensors(self.out / STATE, _STATE_SCHEMA, about, {**self.learner.state(), _HISTORY: history})


def _learn(loop: _Loop, watch: Stopwatch) -> None:
    """All steps that are left."""
    config, learner, journal = loop.config, loop.learner, loop.journal
    saved_s, told = time.monotonic(), 0
    lessons = lessons_from(loop.lessons, learner.steps, config.lessons_ahead)
    try:
        with _interrupts() as interrupted:
            while (done := loop.done(journal.wall_s + watch.wall_s)) < 1:
                ticks = int(done * _BUDGET_TICKS) if config.budget_s is not None else learner.steps
                loop.advance(ticks - told)
                told = ticks
                lesson = next(lessons)
                journal.history.append(learner.step(lesson, done))
                journal.pictures += len(lesson.region)
                if interrupted.is_set() or time.monotonic() - saved_s > config.state_every_s:
                    loop.save(watch)
                    saved_s = time.monotonic()
                if interrupted.is_set():
                    raise KeyboardInterrupt
            loop.advance(_ticks(config, loop.lessons) - told)
    finally:
        lessons.close()


def _check_free(out: Path) -> None:
    """See that nothing of somebody else would be overwritten: hidden files do not count, as systems leave them."""
    if out.exists() and not out.is_dir():
        raise InputError(f"a folder to train in, {out}", "a file", "name another")
    if not out.is_dir() or (out / STATE).is_file():
        return
    others = sorted(path.name for path in out.iterdir() if not path.name.startswith("."))
    if others:
        raise InputError(
            f"a new or empty folder, or one with a training that {RUN} or {STATE} tells of, in {out}",
            f"one with {others[0]}" + (f" and {len(others) - 1} more" if others[1:] else ""),
            "use another folder",
        )


def _begin(
    lessons: Lessons, config: TrainConfig, out: Path, origin: Origin, start: Checkpoint | None
) -> tuple[Learner, _Journal]:
    """A learner at its first step, or where the state in the folder says."""
    path = out / STATE
    if not path.is_file():
        fresh = Learner(config, lessons.subject, lessons.positions_mm(), resolved_precision(config), start)
        return fresh, _Journal([], commit())
    about, tensors = read_tensors(path, _STATE_SCHEMA, "a training's state", f"remove {out} to start anew")
    origin.check(about, out)
    learner = Learner(config, lessons.subject, lessons.positions_mm(), str(about["precision"]), start)
    history = tensors.pop(_HISTORY)
    learner.restore(tensors, int(about["steps"]))
    _log.info("going on after step %d of the training in %s", learner.steps, out)
    before, here = about.get("commit", "unknown"), commit()
    by = here if before == here else f"{before}, then {here}"
    spent = int(about["pictures"]), float(about["wall_s"]), float(about["cpu_s"])
    return learner, _Journal(history.tolist(), by, *spent)


def _steps(config: TrainConfig, lessons: Lessons) -> int:
    return config.steps if config.steps is not None else (config.epochs or 0) * lessons.per_epoch


def _ticks(config: TrainConfig, lessons: Lessons) -> int:
    return _BUDGET_TICKS if config.budget_s is not None else _steps(config, lessons)


def _reported_together(config: TrainConfig, lessons: Lessons, steps: int) -> int:
    """An epoch, or less where epochs are not counted and would leave a short training with hardly a curve."""
    if config.epochs is not None:
        return lessons.per_epoch
    few = max([n for n in (1, 2, 5, 10, 20, 50, 100) if n * _LEAST_POINTS <= steps], default=1)
    return min(few, lessons.per_epoch)


@contextmanager
def _interrupts() -> Iterator[threading.Event]:
    """Inside the block, on the main thread, Ctrl-C sets an event instead of breaking off a step."""
    event = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield event
        return
    before = signal.signal(signal.SIGINT, lambda number, frame: event.set())
    try:
        yield event
    finally:
        signal.signal(signal.SIGINT, before)


def _write_run(run: TrainingRun, origin: Origin, by: str | None) -> None:
    content = {
        "schema": _RUN_SCHEMA,
        **origin.record(),
        "commit": by,
        "seed": run.seed,
        "per_epoch": run.per_epoch,
        "pictures": run.pictures,
        "wall_s": round(run.wall_s, 3),
        "cpu_s": round(run.cpu_s, 3),
        "parts": list(PARTS),
        "losses": [[float(f"{part:.6g}") for part in step] for step in run.losses.tolist()],
    }
    write_json(run.folder / RUN, content)


def _record(folder: Path) -> dict[str, Any]:
    try:
        content = json.loads((folder / RUN).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise CheckpointError(
            f"a finished training in {folder}", "none that can be read", "check the path or train first"
        ) from error
    if not isinstance(content, dict) or content.get("schema") != _RUN_SCHEMA:
        raise CheckpointError(f"a training's record of schema {_RUN_SCHEMA} in {folder}", "another", "check the path")
    return content
