"""The same training with several seeds, a few at a time, each in a process of its own.

On a machine of few cores this beats giving all cores to one run: a small network on one thread wastes nothing on
waiting for its other half.
"""

from __future__ import annotations

import multiprocessing
import os
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, wait
from contextlib import ExitStack, contextmanager
from multiprocessing.queues import Queue
from multiprocessing.synchronize import Event
from pathlib import Path
from queue import Empty

import numpy as np

from naris.core.atomic import disk_full_told
from naris.core.progress import SILENT, Advance, Progress
from naris.train.config import TrainConfig
from naris.train.data import Examples
from naris.train.loop import TrainingRun, train

_POLL_S = 0.2
_PICTURES = ".pictures-"
_inbox: Queue[tuple[int, str, int]] | None = None
_stop: Event | None = None
_alone = threading.Event()
_at_work = threading.Lock()


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

    On Ctrl-C every run that has begun ends its step and writes its state, no other begins, and KeyboardInterrupt is
    raised; so it is with the runs beside one that fails, and with those whose parent was killed.

    Args:
        examples: what all runs learn from.
        config: of every run but for its seed. `threads` is that of each run; where it is None, several runs have one
            thread each. The weights depend on it in their last bits, and so it never depends on `workers`.
        seeds: of the runs, all different.
        out: folder of the folders.
        workers: processes; 1 trains in this one, one run after the other.
        progress: a task a run.

    Raises:
        ConfigurationChanged, CheckpointError, DatasetError, DiskFull: as `train`.
    """
    folders = {seed: out / f"seed-{seed}" for seed in seeds}
    each = config.with_(threads=1) if config.threads is None and len(seeds) > 1 else config
    configs = {seed: each.with_(seed=seed) for seed in seeds}
    for left_by_a_kill in out.glob(f"{_PICTURES}*"):
        shutil.rmtree(left_by_a_kill, ignore_errors=True)
    if min(workers, len(seeds)) <= 1:
        return [train(examples, configs[seed], folders[seed], progress=progress, task=f"seed {seed}") for seed in seeds]
    light = (examples.region, examples.anatomy_T_camera, examples.subject, examples.group)
    with _on_disk(examples.images, out) as pictures, ExitStack() as tasks:
        context = multiprocessing.get_context("spawn")
        inbox: Queue[tuple[int, str, int]] = context.Queue()
        stop = context.Event()
        pool = ProcessPoolExecutor(
            min(workers, len(seeds)), mp_context=context, initializer=_attach, initargs=(inbox, stop)
        )
        try:
            with _no_interrupts():
                shape = examples.images.shape
                runs = [pool.submit(_one, pictures, shape, light, configs[seed], folders[seed]) for seed in seeds]
            _relay(inbox, runs, progress, tasks)
            return [run.result() for run in runs]
        finally:
            stop.set()
            pool.shutdown(cancel_futures=True)


@contextmanager
def _on_disk(images: np.ndarray, out: Path) -> Iterator[Path]:
    """The pictures in a file that all workers map: once in memory, and no pipe has to carry them."""
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=out, prefix=_PICTURES) as folder:
        path = Path(folder) / "images.bin"
        # numpy's own writer hides from us that the disk is full: its error has no number.
        with disk_full_told(path), path.open("wb") as file:
            file.write(np.ascontiguousarray(images).data)
        yield path


@contextmanager
def _no_interrupts() -> Iterator[None]:
    """Hold Ctrl-C back; processes that start inside hold it back until `_attach` (where the system can: POSIX)."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _attach(inbox: Queue[tuple[int, str, int]], stop: Event) -> None:
    """Make ready the process of a worker; the only way to hand a queue to the processes of a pool."""
    global _inbox, _stop
    _inbox, _stop = inbox, stop
    inbox.cancel_join_thread()  # nobody reads what is told after an interruption: the end must not wait for it
    # A terminal sends Ctrl-C to the workers too. A training minds it, a worker that waits for one leaves it to `_stop`.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """A parent that is killed stops nobody: its workers would go on for hours, and then wait for ever."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        _alone.set()
        with _at_work:  # a training that goes on writes its state first
            os._exit(1)


def _stopped() -> bool:
    return _alone.is_set() or (_stop is not None and _stop.is_set())


def _one(pictures: Path, shape: tuple[int, ...], light: tuple, config: TrainConfig, folder: Path) -> TrainingRun:
    region, poses, subject, group = light
    with _at_work:
        if _stopped():
            raise KeyboardInterrupt
        examples = Examples(np.memmap(pictures, np.uint8, "r", shape=shape), region, poses, subject, group)
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
        return self._advance

    def _advance(self, steps: int) -> None:
        self._tell("advance", steps)
        if _stopped():
            signal.raise_signal(signal.SIGINT)  # the training ends its step, writes its state and stops

    def __exit__(self, *error: object) -> None:
        self._tell("end", 0)

    def _tell(self, word: str, number: int) -> None:
        if _inbox is not None:
            _inbox.put((self.seed, word, number))


def _relay(
    inbox: Queue[tuple[int, str, int]], runs: Sequence[Future[TrainingRun]], progress: Progress, tasks: ExitStack
) -> None:
    """Tell what the workers tell until all have ended; the error of the first that fails is raised at once."""
    open_tasks: dict[int, Advance] = {}
    checked = time.monotonic()
    while True:
        try:
            seed, word, number = inbox.get(timeout=_POLL_S)
        except Empty:
            word = ""
        if not word or time.monotonic() - checked > _POLL_S:
            checked = time.monotonic()
            done, running = wait(runs, timeout=0)
            for run in done:
                run.result()
            if not running and not word:
                return
        if word == "start":
            open_tasks[seed] = tasks.enter_context(progress.task(f"seed {seed}", number))
        elif word == "advance" and seed in open_tasks:
            open_tasks[seed](number)
