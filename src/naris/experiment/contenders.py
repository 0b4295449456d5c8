"""The networks of an experiment, each trained in its way: what is compared, and how to make it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from naris.core.progress import Progress
from naris.dataset.read import Dataset
from naris.dataset.stream import ViewStream
from naris.experiment.stages import Journal
from naris.model.checkpoint import Checkpoint
from naris.train import Examples, TrainConfig, TrainingRun, train, train_runs

TWO_LAYER, COMPACT, COMPACT_AT_WILL = "two_layer", "compact", "compact_at_will"
STEERED_SHARE = 0.5
"""Of the views at will: half are of a camera that is steered through the passages."""


@dataclass(frozen=True)
class Plan:
    """One network, trained one way.

    Attributes:
        key: in the names of figures.
        label: short, for tables and charts.
        description: what the network is, one sentence.
        trained_on: what it learns from, one sentence.
        config: how it learns.
        seeds: of its runs.
        workers: runs at a time.
        start: weights to begin with, on views at will.
    """

    key: str
    label: str
    description: str
    trained_on: str
    config: TrainConfig
    seeds: tuple[int, ...]
    workers: int = 1
    start: Checkpoint | None = None


@dataclass(frozen=True, eq=False)
class Contender:
    """A plan and the runs that came of it."""

    plan: Plan
    runs: tuple[TrainingRun, ...]

    @property
    def checkpoints(self) -> Sequence[Path]:
        return [run.checkpoint for run in self.runs]


TWO_LAYER_LABEL = "two-layer, fixed pictures"
TWO_LAYER_WORDS = (
    "Two convolutions and three linear layers on raw pixels, as published: 300×300, no normalisation, no augmentation."
)
COMPACT_WORDS = (
    "A small residual network of ours on square pictures of normalised brightness: heads for the region, for the"
    " camera's pose with its uncertainty, and for whether a picture is of this world at all."
)


def from_pictures(plan: Plan, pictures: Dataset, out: Path, journal: Journal, progress: Progress) -> Contender:
    """Train on a fixed set, a run a seed, in `out/<key>`; finished runs are kept, an interrupted one goes on."""
    with journal.stage(_stage(plan)):
        runs = train_runs(
            Examples.of(pictures), plan.config, plan.seeds, out / plan.key, workers=plan.workers, progress=progress
        )
    return _told(Contender(plan, tuple(runs)), journal)


def from_views_at_will(plan: Plan, stream: ViewStream, out: Path, journal: Journal, progress: Progress) -> Contender:
    """Train on views that are rendered as the network learns, a run a seed, in `out/<key>/seed-<seed>`."""
    folders = [out / plan.key / f"seed-{seed}" for seed in plan.seeds]
    with journal.stage(_stage(plan)):
        runs = [
            train(
                stream,
                plan.config.with_(seed=seed),
                folder,
                start=plan.start,
                progress=progress,
                task=f"{plan.label}, seed {seed}",
            )
            for seed, folder in zip(plan.seeds, folders, strict=True)
        ]
    return _told(Contender(plan, tuple(runs)), journal)


def _stage(plan: Plan) -> str:
    return f"train {plan.key}"


def _told(contender: Contender, journal: Journal) -> Contender:
    runs, plan = contender.runs, contender.plan
    made = f"{len(runs)} {'run' if len(runs) == 1 else 'runs'} of {runs[0].steps:,} steps"
    journal.note(_stage(plan), made, f"train: {plan.label}")
    return contender
