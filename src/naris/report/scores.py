"""How networks did on test sets: confusion, calibration and pose errors of each run, and of all runs together."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from naris.errors import InputError


@dataclass(frozen=True, eq=False)
class Calibration:
    """How often the network is right when it is a given amount sure, in B bins of its highest probability.

    Attributes:
        confidence: (B,) mean highest probability in the bin (anything where empty).
        accuracy: (B,) share of right answers in the bin (anything where empty).
        count: (B,) pictures in the bin.
    """

    confidence: Float[np.ndarray, "b"]
    accuracy: Float[np.ndarray, "b"]
    count: Int[np.ndarray, "b"]

    @property
    def ece(self) -> float:
        """Expected calibration error (Naeini et al. 2015): the mean gap between the two, weighted by pictures."""
        used = self.count > 0
        gap = np.abs(self.confidence - self.accuracy)[used]
        return float((gap * self.count[used]).sum() / max(self.count.sum(), 1))

    @property
    def mean_confidence(self) -> float:
        used = self.count > 0
        return float((self.confidence * self.count)[used].sum() / max(self.count.sum(), 1))


@dataclass(frozen=True, eq=False)
class PoseErrors:
    """How far predicted cameras are off, over all test pictures: (N,) mm and (N,) degrees."""

    position_mm: Float[np.ndarray, "n"]
    rotation_deg: Float[np.ndarray, "n"]

    @property
    def median_mm(self) -> float:
        return float(np.median(self.position_mm))

    @property
    def median_deg(self) -> float:
        return float(np.median(self.rotation_deg))

    def share_within(self, position_mm: float, rotation_deg: float) -> float:
        """Share of pictures whose camera is found within both bounds."""
        return float(((self.position_mm <= position_mm) & (self.rotation_deg <= rotation_deg)).mean())


@dataclass(frozen=True, eq=False)
class RunScore:
    """How the network of one training run did on one test set.

    Attributes:
        seed: of the run.
        confusion: (K, K) counts, true region by row, answer by column.
        calibration: of the region probabilities, or None.
        pose: errors of predicted poses, None for a network without a pose head.
    """

    seed: int
    confusion: Int[np.ndarray, "k k"]
    calibration: Calibration | None = None
    pose: PoseErrors | None = None

    def __post_init__(self) -> None:
        if self.confusion.sum() == 0:
            raise InputError("a score over at least one picture", "an empty confusion matrix", "leave the run out")

    @property
    def count(self) -> int:
        return int(self.confusion.sum())

    @property
    def accuracy(self) -> float:
        return float(np.trace(self.confusion) / self.confusion.sum())

    @property
    def chance(self) -> float:
        """What always naming the commonest region of the test set would score."""
        return float(self.confusion.sum(axis=1).max() / self.confusion.sum())

    @property
    def wrong(self) -> int:
        """Wrong answers."""
        return int(self.confusion.sum() - np.trace(self.confusion))

    def nonneighbour_error(self, neighbours: Bool[np.ndarray, "k k"]) -> float | None:
        """Share of the wrong answers that name a region which does not touch the true one; None where none is wrong."""
        return float(self.confusion[~neighbours].sum() / self.wrong) if self.wrong else None


@dataclass(frozen=True, eq=False)
class TestResult:
    """All runs of one network on one test set, at least one.

    Attributes:
        split: the key of a `Split`.
        runs: one score a run.
        interval: 95 % interval of the mean accuracy, by bootstrap over runs and over camera positions (all views of a
            position together: they are near-copies), or None.
    """

    __test__ = False  # not a test for pytest to collect

    split: str
    runs: tuple[RunScore, ...]
    interval: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        if not self.runs:
            raise InputError("at least one run on every test set", f"none on {self.split}", "leave the test set out")

    @property
    def accuracies(self) -> Float[np.ndarray, "r"]:
        return np.array([run.accuracy for run in self.runs])

    @property
    def mean(self) -> float:
        return float(self.accuracies.mean())

    @property
    def std(self) -> float | None:
        """Sample standard deviation between runs; None for a single run."""
        return float(self.accuracies.std(ddof=1)) if len(self.runs) > 1 else None

    @property
    def chance(self) -> float:
        return self.runs[0].chance

    @property
    def confusion(self) -> Int[np.ndarray, "k k"]:
        """Counts over all runs."""
        return np.sum([run.confusion for run in self.runs], axis=0)

    @property
    def wrong(self) -> int:
        """Wrong answers of all runs."""
        return sum(run.wrong for run in self.runs)

    def nonneighbour_error(self, neighbours: Bool[np.ndarray, "k k"]) -> float | None:
        """Share of `wrong` that names a region which does not touch the true one; None where none is wrong."""
        return RunScore(0, self.confusion).nonneighbour_error(neighbours)

    @property
    def calibration(self) -> Calibration | None:
        """Of all runs together; None if a run has none."""
        parts = [run.calibration for run in self.runs if run.calibration is not None]
        if len(parts) < len(self.runs):
            return None
        count = np.sum([part.count for part in parts], axis=0)
        full = np.maximum(count, 1)
        confidence, accuracy = (
            np.sum([np.where(p.count > 0, getattr(p, name) * p.count, 0.0) for p in parts], axis=0) / full
            for name in ("confidence", "accuracy")
        )
        return Calibration(confidence, accuracy, count)

    @property
    def pose(self) -> PoseErrors | None:
        """Of all runs together; None if a run has none."""
        parts = [run.pose for run in self.runs if run.pose is not None]
        if len(parts) < len(self.runs):
            return None
        return PoseErrors(
            np.concatenate([part.position_mm for part in parts]), np.concatenate([part.rotation_deg for part in parts])
        )
