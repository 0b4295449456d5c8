"""The same training with several seeds, a few at a time, each in a process of its own.

On a machine of few cores this beats giving all cores to one run: a small network on one thread wastes nothing on
waiting for its other half.
"""

from __future__ import annotations

import multiprocessing
import tempfile
from collections.abc import Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from contextlib import ExitStack
from multiprocessing.queues import Queue
from pathlib import Path
from queue import Empty

import numpy as np

from naris.core.progress import SILENT, Advance, Progress
from naris.train.config import TrainConfig
from naris.train.data import Examples
from naris.train.loop import TrainingRun, train

_POLL_S = 0.2
_inbox: Queue[tuple[int, str, int]] | None = None


def train_runs(
    examples: Examples,
    config: TrainConfig,
    seeds: Sequence[int],
    out: Path,
    *,
    workers: int = 1,
    progress: Progress = SILENT,
) -> list[TrainingRun]:
    """One training a seed, in the folders `out/seed-<seed>`; finished ones are read, interrupted ones go on.

    Args:
        examples: what all runs learn from.
        config: of every run but for its seed. `threads` is that of each run.
        seeds: of the runs, all different.
        out: folder of the folders.
        workers: processes; 1 trains in this one, one run after the other.
        progress: a task a run.

    Raises:
        ConfigurationChanged, CheckpointError, DatasetError, DiskFull: as `train`.
    """
    folders = {seed: out / f"seed-{seed}" for seed in seeds}
    configs = {seed: config.with_(seed=seed) for seed in seeds}
    if workers <= 1:
        return [train(examples, configs[seed], folders[seed], progress=progress, task=f"seed {seed}") for seed in seeds]
    out.mkdir(parents=True, exist_ok=True)
    # The pictures go through a file that all workers map: once in memory, and no pipe has to carry them.
    with tempfile.TemporaryDirectory(dir=out, prefix=".pictures-") as folder, ExitStack() as tasks:
        pictures = Path(folder) / "images.npy"
        np.save(pictures, examples.images)
        context = multiprocessing.get_context("spawn")
        inbox: Queue[tuple[int, str, int]] = context.Queue()
        light = (examples.region, examples.anatomy_T_camera, examples.subject, examples.group)
        with ProcessPoolExecutor(workers, mp_context=context, initializer=_attach, initargs=(inbox,)) as pool:
            runs = [pool.submit(_one, pictures, light, configs[seed], folders[seed]) for seed in seeds]
            _relay(inbox, runs, progress, tasks)
            return [run.result() for run in runs]


def _attach(inbox: Queue[tuple[int, str, int]]) -> None:
    global _inbox  # the only way to hand a queue to the processes of a pool
    _inbox = inbox


def _one(pictures: Path, light: tuple, config: TrainConfig, folder: Path) -> TrainingRun:
    region, poses, subject, group = light
    examples = Examples(np.load(pictures, mmap_mode="r"), region, poses, subject, group)
    return train(examples, config, folder, progress=_Remote(config.seed))


class _Remote:
    """Progress that is told to the process that waits."""

    def __init__(self, seed: int) -> None:
        self.seed = seed

    def task(self, name: str, total: int) -> _RemoteTask:
        return _RemoteTask(self.seed, total)


class _RemoteTask:
    def __init__(self, seed: int, total: int) -> None:
        self.seed = seed
        self._tell("start", total)

    def __enter__(self) -> Advance:
        return lambda steps: self._tell("advance", steps)

    def __exit__(self, *error: object) -> None:
        self._tell("end", 0)

    def _tell(self, word: str, number: int) -> None:
        if _inbox is not None:
            _inbox.put((self.seed, word, number))


def _relay(
    inbox: Queue[tuple[int, str, int]], runs: Sequence[Future[TrainingRun]], progress: Progress, tasks: ExitStack
) -> None:
    """Tell what the workers tell, until all have ended or one has failed."""
    open_tasks: dict[int, Advance] = {}
    while True:
        try:
            seed, word, number = inbox.get(timeout=_POLL_S)
        except Empty:
            done, running = wait(runs, timeout=0)
            failed = any(run.exception() is not None for run in done)
            if failed:
                for run in runs:
                    run.cancel()
            if failed or not running:
                return
            continue
        if word == "start":
            open_tasks[seed] = tasks.enter_context(progress.task(f"seed {seed}", number))
        elif word == "advance" and seed in open_tasks:
            open_tasks[seed](number)
