"""The same training with several seeds, a few at a time, each in a process of its own.

On a machine of few cores this beats giving all cores to one run: a small network on one thread wastes nothing on
waiting for its other half.
"""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from naris.core.atomic import disk_full_told
from naris.core.progress import SILENT, Progress
from naris.core.side_by_side import side_by_side
from naris.train.config import TrainConfig
from naris.train.data import Examples
from naris.train.loop import TrainingRun, train

_PICTURES = ".pictures-"


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
    with _on_disk(examples.images, out) as pictures:
        shape = examples.images.shape
        jobs = [partial(_one, pictures, shape, light, configs[seed], folders[seed]) for seed in seeds]
        return side_by_side(jobs, min(workers, len(seeds)), progress)


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


def _one(
    pictures: Path, shape: tuple[int, ...], light: tuple, config: TrainConfig, folder: Path, progress: Progress
) -> TrainingRun:
    region, poses, subject, group = light
    examples = Examples(np.memmap(pictures, np.uint8, "r", shape=shape), region, poses, subject, group)
    return train(examples, config, folder, progress=progress, task=f"seed {config.seed}")
