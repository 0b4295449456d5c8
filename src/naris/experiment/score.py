"""How the runs of a contender did on each test set."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from naris.core.pose import Pose, distance
from naris.core.progress import Progress
from naris.core.results import Prediction
from naris.dataset.read import Dataset
from naris.experiment.contenders import Contender
from naris.model.localizer import open_localizer
from naris.report.scores import Calibration, PoseErrors, RunScore, TestResult

_BINS = 10
_RESAMPLES = 2000


def score(contender: Contender, tests: Mapping[str, Dataset], progress: Progress) -> tuple[TestResult, ...]:
    """Every run on every test set.

    The interval is a cluster bootstrap (Efron and Tibshirani 1993): positions are drawn with replacement, each with all
    its views, because the ten views of a position are near-copies, and runs are drawn likewise.
    """
    found = {split: (pictures, pictures.images()) for split, pictures in tests.items()}
    scores: dict[str, list[RunScore]] = {split: [] for split in found}
    hits: dict[str, list[np.ndarray]] = {split: [] for split in found}
    with progress.task(f"evaluate {contender.plan.label}", len(contender.runs) * len(found)) as advance:
        for run in contender.runs:
            localizer = open_localizer(run.checkpoint)
            for split, (pictures, images) in found.items():
                predictions = localizer.predict(images)
                scores[split].append(score_run(run.seed, predictions, pictures))
                hits[split].append(np.array([p.region for p in predictions]) == pictures.labels)
                advance(1)
    rng = np.random.default_rng(0)
    return tuple(
        TestResult(split, tuple(scores[split]), _interval(np.stack(hits[split]), found[split][0].views.position, rng))
        for split in found
    )


def score_run(seed: int, predictions: list[Prediction], pictures: Dataset) -> RunScore:
    """One run on one test set."""
    k = len(pictures.regions.names)
    probabilities = np.stack([p.probabilities for p in predictions])
    answer = probabilities.argmax(axis=1)
    confusion = np.zeros((k, k), dtype=np.int64)
    np.add.at(confusion, (pictures.labels, answer), 1)
    return RunScore(
        seed,
        confusion,
        reliability(probabilities.max(axis=1), answer == pictures.labels),
        pose_errors(predictions, pictures.anatomy_T_camera),
    )


def reliability(confidence: Float[np.ndarray, "n"], right: Bool[np.ndarray, "n"]) -> Calibration:
    """Ten equal bins of the highest probability: its mean and the share of right answers in each."""
    which = np.minimum((confidence * _BINS).astype(int), _BINS - 1)
    count = np.bincount(which, minlength=_BINS)
    full = np.maximum(count, 1)
    mean = np.bincount(which, confidence, minlength=_BINS) / full
    accuracy = np.bincount(which, right.astype(float), minlength=_BINS) / full
    return Calibration(mean, accuracy, count)


def pose_errors(predictions: list[Prediction], truth: Pose) -> PoseErrors | None:
    """Of the best hypothesis of each prediction; None for a network without a pose head."""
    best = [p.hypotheses.matrix[0] for p in predictions if p.hypotheses is not None]
    if len(best) < len(predictions):
        return None
    off_mm, off_rad = distance(truth, Pose(np.stack(best), truth.target, truth.source))
    return PoseErrors(off_mm, np.rad2deg(off_rad))


def _interval(hits: Bool[np.ndarray, "r n"], position: np.ndarray, rng: np.random.Generator) -> tuple[float, float]:
    """95 % of the resampled mean accuracies lie within."""
    _, cluster = np.unique(position, return_inverse=True)
    count = np.bincount(cluster).astype(float)
    right = np.stack([np.bincount(cluster, row.astype(float)) for row in hits])
    runs, clusters = hits.shape[0], len(count)
    drawn = rng.integers(clusters, size=(_RESAMPLES, clusters))
    of_run = rng.integers(runs, size=(_RESAMPLES, runs))
    share = [right[r][:, d].sum() / (count[d].sum() * runs) for r, d in zip(of_run, drawn, strict=True)]
    low, high = np.percentile(share, [2.5, 97.5])
    return float(low), float(high)
