"""Training: settings, data, the loop, runs side by side.

>>> from naris.train import COMPACT_AT_WILL, Examples, PUBLISHED, train          # doctest: +SKIP
>>> run = train(Examples.of(dataset), PUBLISHED, Path("out/run-0"))              # doctest: +SKIP
"""

from naris.train.config import (
    COMPACT_AT_WILL,
    COMPACT_DEMO,
    COMPACT_FEW,
    COMPACT_ON,
    PUBLISHED,
    Adam,
    Muon,
    Replay,
    TrainConfig,
)
from naris.train.data import Examples, Stream
from naris.train.loop import TrainingRun, read_run, train
from naris.train.runs import train_runs

__all__ = [
    "COMPACT_AT_WILL",
    "COMPACT_DEMO",
    "COMPACT_FEW",
    "COMPACT_ON",
    "PUBLISHED",
    "Adam",
    "Examples",
    "Muon",
    "Replay",
    "Stream",
    "TrainConfig",
    "TrainingRun",
    "read_run",
    "train",
    "train_runs",
]
