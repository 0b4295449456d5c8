"""Figures from what a model said: of one run, and of several runs together.

Intervals are from a cluster bootstrap (B. Efron, R. Tibshirani 1993; A. Davison, D. Hinkley 1997): whole positions (or
trajectories) are drawn with replacement, because the views of one are near-copies of each other, and drawing views one
by one would make the interval several times too narrow. Over several runs the runs are drawn likewise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.stats import chi2

from naris.core.pose import CAMERA, Pose, distance, rotation_vector
from naris.errors import DatasetError
from naris.evaluate.predictions import Said, clusters

NEAR_MM, NEAR_DEG = 4.0, 15.0
"""A predicted camera this near to the true one lets a registration begin."""

_BINS = 10
_RESAMPLES = 2000
_INTERVAL = (2.5, 97.5)
_REFUSED = 0.5
_CLAIM = 0.95

Cluster = Literal["position", "trajectory"]


@dataclass(frozen=True, eq=False)
class Reliability:
    """How often a model is right when it is so sure, in ten equal bins of its highest probability.

    Attributes:
        confidence: (B,) mean highest probability in the bin; 0 where it is empty.
        accuracy: (B,) share of right answers in the bin; 0 where it is empty.
        count: (B,) pictures in the bin.
    """

    confidence: Float[np.ndarray, "b"]
    accuracy: Float[np.ndarray, "b"]
    count: Int[np.ndarray, "b"]

    @property
    def ece(self) -> float:
        """Expected calibration error (M. Naeini et al. 2015): the gap between the two, mean over the pictures."""
        return float((np.abs(self.confidence - self.accuracy) * self.count).sum() / self.count.sum())

    def to_json(self) -> dict[str, Any]:
        bins = {name: getattr(self, name).tolist() for name in ("confidence", "accuracy", "count")}
        return {"ece": self.ece, **bins}


@dataclass(frozen=True)
class PoseScore:
    """How far the best hypotheses are off, over all pictures, refused ones too.

    Attributes:
        median_mm, p90_mm, median_deg, p90_deg: of the camera's place and orientation.
        near: share within 4 mm and 15°.
        any_near: share with any hypothesis so near.
        in_claim: share of the true cameras inside the 95 % ellipsoid that the best hypothesis claims, or None.
    """

    median_mm: float
    p90_mm: float
    median_deg: float
    p90_deg: float
    near: float
    any_near: float
    in_claim: float | None


@dataclass(frozen=True, eq=False)
class Score:
    """One run on one test set.

    Attributes:
        seed: of the run.
        pictures, clusters: how many.
        accuracy: share of pictures whose most probable region is the true one.
        interval: 95 % of the resampled accuracies lie within.
        confusion: (K, K) counts, true region by row, answer by column.
        nonneighbour_error: share of the wrong answers that name a region which does not touch the true one; None where
            none is wrong.
        reliability: of the stated probabilities.
        pose: None for a model without a pose head, or of another anatomy than the pictures show.
        refused: share of the pictures that the model says are none of its world; None if it does not judge.
    """

    seed: int
    pictures: int
    clusters: int
    accuracy: float
    interval: tuple[float, float]
    confusion: Int[np.ndarray, "k k"]
    nonneighbour_error: float | None
    reliability: Reliability
    pose: PoseScore | None
    refused: float | None

    def to_json(self) -> dict[str, Any]:
        return {
            "seed": self.seed,
            "pictures": self.pictures,
            "clusters": self.clusters,
            "accuracy": self.accuracy,
            "interval": list(self.interval),
            "confusion": self.confusion.tolist(),
            "nonneighbour_error": self.nonneighbour_error,
            "reliability": self.reliability.to_json(),
            "pose": None if self.pose is None else asdict(self.pose),
            "refused": self.refused,
        }


@dataclass(frozen=True, eq=False)
class Summary:
    """Several runs on one test set.

    Attributes:
        scores: of each run.
        mean: accuracy.
        std: sample standard deviation of the accuracy between runs; None for one run.
        interval: 95 % of the means over resampled runs and clusters lie within.
        nonneighbour_error: share of all runs' wrong answers; None where none is wrong.
    """

    scores: tuple[Score, ...]
    mean: float
    std: float | None
    interval: tuple[float, float]
    nonneighbour_error: float | None

    def to_json(self) -> dict[str, Any]:
        return {
            "mean": self.mean,
            "std": self.std,
            "interval": list(self.interval),
            "nonneighbour_error": self.nonneighbour_error,
            "scores": [score.to_json() for score in self.scores],
        }


def score(said: Said, *, by: Cluster = "position", rng: np.random.Generator | None = None) -> Score:
    """Figures of one run.

    Args:
        said: at least one picture.
        by: what the bootstrap draws.
        rng: for the bootstrap; seeded with 0 when None.

    Raises:
        DatasetError: if there is no picture.
    """
    if not len(said):
        raise DatasetError("at least one picture to score", "none", "evaluate on another data set")
    right = said.answer == said.region
    number = clusters(said, by)
    confusion = confusion_matrix(said)
    return Score(
        said.seed,
        len(said),
        int(number.max()) + 1,
        float(right.mean()),
        bootstrap(right[None], number, rng or np.random.default_rng(0)),
        confusion,
        nonneighbour_error(confusion, said.regions.neighbours),
        reliability(np.exp(said.log_probabilities.max(axis=1)), right),
        _pose_score(said),
        None if said.out_of_domain is None else float((said.out_of_domain > _REFUSED).mean()),
    )


def summary(runs: Sequence[Said], *, by: Cluster = "position", rng: np.random.Generator | None = None) -> Summary:
    """Figures of several runs on the same pictures.

    Raises:
        DatasetError: if there is no run, or the runs are about different pictures.
    """
    if not runs or any(not np.array_equal(run.region, runs[0].region) for run in runs):
        raise DatasetError("runs on the same pictures", f"{len(runs)} on others", "evaluate them on one data set")
    scores = tuple(score(run, by=by) for run in runs)
    right = np.stack([run.answer == run.region for run in runs])
    accuracy = np.array([one.accuracy for one in scores])
    confusion = np.sum([one.confusion for one in scores], axis=0)
    return Summary(
        scores,
        float(accuracy.mean()),
        float(accuracy.std(ddof=1)) if len(scores) > 1 else None,
        bootstrap(right, clusters(runs[0], by), rng or np.random.default_rng(0)),
        nonneighbour_error(confusion, runs[0].regions.neighbours),
    )


def confusion_matrix(said: Said) -> Int[np.ndarray, "k k"]:
    """Counts, true region by row, answer by column."""
    k = len(said.regions.names)
    counts = np.zeros((k, k), dtype=np.int64)
    np.add.at(counts, (said.region, said.answer), 1)
    return counts


def nonneighbour_error(confusion: Int[np.ndarray, "k k"], neighbours: Bool[np.ndarray, "k k"]) -> float | None:
    """Share of the wrong answers that name a region which does not touch the true one; None where none is wrong."""
    wrong = int(confusion.sum() - np.trace(confusion))
    return float(confusion[~neighbours].sum() / wrong) if wrong else None


def reliability(confidence: Float[np.ndarray, "n"], right: Bool[np.ndarray, "n"]) -> Reliability:
    """Ten equal bins from 0 to 1."""
    which = np.clip((confidence * _BINS).astype(np.int64), 0, _BINS - 1)
    count = np.bincount(which, minlength=_BINS)
    full = np.maximum(count, 1)
    mean = np.bincount(which, confidence, minlength=_BINS) / full
    return Reliability(mean, np.bincount(which, right.astype(float), minlength=_BINS) / full, count)


def bootstrap(
    right: Bool[np.ndarray, "r n"], cluster: Int[np.ndarray, "n"], rng: np.random.Generator
) -> tuple[float, float]:
    """The 95 % interval of the mean accuracy over resampled clusters and (if there are several) runs."""
    count = np.bincount(cluster).astype(float)
    hits = np.stack([np.bincount(cluster, row.astype(float)) for row in right])
    drawn = rng.integers(len(count), size=(_RESAMPLES, len(count)))
    of_run = rng.integers(len(hits), size=(_RESAMPLES, len(hits)))
    per_run = hits[:, drawn].sum(axis=2) / count[drawn].sum(axis=1)
    shares = per_run[of_run, np.arange(_RESAMPLES)[:, None]].mean(axis=1)
    low, high = np.percentile(shares, _INTERVAL)
    return float(low), float(high)


def _pose_score(said: Said) -> PoseScore | None:
    if said.hypotheses is None:
        return None
    hypotheses, truth = said.hypotheses, said.anatomy_T_camera
    m = hypotheses.shape[1]
    repeated = Pose(np.repeat(truth.matrix[:, None], m, axis=1), truth.target, truth.source)
    off_mm, off_rad = distance(hypotheses, repeated)
    off_deg = np.rad2deg(off_rad)
    near = (off_mm <= NEAR_MM) & (off_deg <= NEAR_DEG)
    best = Pose(hypotheses.matrix[:, 0], hypotheses.target, CAMERA)
    return PoseScore(
        float(np.median(off_mm[:, 0])),
        float(np.percentile(off_mm[:, 0], 90)),
        float(np.median(off_deg[:, 0])),
        float(np.percentile(off_deg[:, 0], 90)),
        float(near[:, 0].mean()),
        float(near.any(axis=1).mean()),
        None if said.covariance is None else _in_claim(best, truth, said.covariance[:, 0]),
    )


def _in_claim(best: Pose, truth: Pose, covariance: Float[np.ndarray, "n 6 6"]) -> float:
    """Share of the true cameras inside the ellipsoid of the claimed covariance that should hold 95 % of them."""
    back = np.swapaxes(best.rotation, -1, -2)
    shift = (back @ (truth.position_mm - best.position_mm)[..., None])[..., 0]
    error = np.concatenate([shift, rotation_vector(back @ truth.rotation)], axis=-1)
    square = (error * np.linalg.solve(covariance, error[..., None])[..., 0]).sum(axis=-1)
    return float((square <= chi2.ppf(_CLAIM, error.shape[-1])).mean())


def normalised_square(best: Pose, truth: Pose, covariance: Float[np.ndarray, "6 6"]) -> float:
    """The error of a pose over its covariance, squared, a degree of freedom: 1 on average where that is right.

    Twists are of the camera, as `Pose.exp` has them (mm, rad).
    """
    twist = (best.inverse() @ truth).log()
    return float(twist @ np.linalg.solve(covariance, twist)) / len(twist)


def auroc(score: Float[np.ndarray, "n"], right: Bool[np.ndarray, "n"]) -> float | None:
    """The chance that a right one scores higher than a wrong one (Mann and Whitney 1947)."""
    if right.all() or not right.any():
        return None
    above = score[right][:, None] - score[~right][None]
    return float((above > 0).mean() + 0.5 * (above == 0).mean())
