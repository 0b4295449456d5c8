"""How the runs of a contender did on each test set, as a report tells of it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from naris.core.pose import Pose, distance
from naris.core.progress import Progress
from naris.dataset.read import Dataset
from naris.evaluate import Said, export, summary
from naris.experiment.contenders import Contender
from naris.model.localizer import open_localizer
from naris.report.scores import Calibration, PoseErrors, RunScore, TestResult


def score(contender: Contender, tests: Mapping[str, Dataset], progress: Progress) -> tuple[TestResult, ...]:
    """Every run on every test set; what a run said is kept beside its weights, and asked only once."""
    said: dict[str, list[Said]] = {split: [] for split in tests}
    with progress.task(f"evaluate {contender.plan.label}", len(contender.runs) * len(tests)) as advance:
        for run in contender.runs:
            localizer = open_localizer(run.checkpoint)
            for split, pictures in tests.items():
                said[split].append(export(localizer, pictures, run.folder / f"said-{split}.npz"))
                advance(1)
    return tuple(_test_result(split, runs) for split, runs in said.items())


def _test_result(split: str, runs: list[Said]) -> TestResult:
    """The intervals are cluster bootstraps over positions and runs (`naris.evaluate`)."""
    found = summary(runs)
    scores = tuple(
        RunScore(
            of_run.seed,
            of_run.confusion,
            Calibration(of_run.reliability.confidence, of_run.reliability.accuracy, of_run.reliability.count),
            pose_errors(said.hypotheses, said.anatomy_T_camera),
        )
        for of_run, said in zip(found.scores, runs, strict=True)
    )
    return TestResult(split, scores, found.interval)


def pose_errors(hypotheses: Pose | None, truth: Pose) -> PoseErrors | None:
    """Of the best of each picture's hypotheses (N, M), best first; None for a network without a pose head."""
    if hypotheses is None:
        return None
    off_mm, off_rad = distance(hypotheses[:, 0], truth)
    return PoseErrors(off_mm, np.rad2deg(off_rad))
