"""Synthetic report data, for the tests of the page alone: drawn at random, made by no network."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from naris.core.anatomy import Anatomy, SlabRegions
from naris.core.results import Prediction
from naris.report import (
    SINHA_2018,
    AnatomyView,
    Calibration,
    Line,
    LocatedFrame,
    NearestPair,
    NetworkResult,
    PoseErrors,
    ReportData,
    RunScore,
    Split,
    Stage,
    TestResult,
    TrainingCurve,
    ViewSet,
)

NAMES = ("slab 1 (anterior)", "slab 2", "slab 3", "slab 4 (posterior)")


def tube() -> Anatomy:
    """A closed tube along y with the paper's slabs."""
    mesh = trimesh.creation.capsule(height=60, radius=8, count=(24, 24))
    y_up = mesh.vertices[:, [0, 2, 1]] * [1, 1, -1]
    regions = SlabRegions("paper", NAMES, "mean", 1, (-30.0, -15.0, 0.0))
    faces = np.asarray(mesh.faces, dtype=np.int32)
    return Anatomy(y_up - [0, 5, 0], faces, "mean", "a test tube", "made by the tests", {"paper": regions})


def images(rng: np.random.Generator, count: int, size: int = 96) -> np.ndarray:
    """Smooth random pictures."""
    y, x = np.mgrid[:size, :size] / size
    made = []
    for _ in range(count):
        a, b, c = rng.uniform(0.2, 6, 3)
        tone = 0.5 + 0.5 * np.sin(a * x * 6 + b * y * 6 + c)
        made.append(np.stack([230 * tone, 140 * tone**1.5, 120 * tone**2], axis=-1))
    return np.array(made, dtype=np.uint8).reshape(count, size, size, 3)


def score(rng: np.random.Generator, seed: int, accuracy: float, *, pose: bool, count: int = 150) -> RunScore:
    """A run that is right about as often as asked, sure of itself, and wrong mostly between neighbours."""
    truth = rng.integers(0, 4, count)
    step = rng.choice([-1, 1, 2], count, p=[0.46, 0.46, 0.08])
    answer = np.where(rng.random(count) < accuracy, truth, np.clip(truth + step, 0, 3))
    confusion = np.zeros((4, 4), dtype=int)
    np.add.at(confusion, (truth, answer), 1)
    confidence = np.linspace(0.25, 0.98, 10)
    share = np.clip(confidence * accuracy / 0.8, 0, 1)
    calibration = Calibration(confidence, share, np.array([0, 2, 4, 6, 8, 10, 15, 20, 35, 50]))
    errors = PoseErrors(rng.gamma(2, 1.5, count), rng.gamma(2, 5, count)) if pose else None
    return RunScore(seed, confusion, calibration, errors)


def tested(rng: np.random.Generator, split: str, accuracy: float, runs: int, *, pose: bool) -> TestResult:
    scores = tuple(score(rng, i, accuracy + rng.normal(0, 0.015), pose=pose) for i in range(runs))
    mean = float(np.mean([s.accuracy for s in scores]))
    return TestResult(split, scores, (mean - 0.03, mean + 0.03))


def network(rng: np.random.Generator, key: str, label: str, accuracies: dict[str, float], runs: int) -> NetworkResult:
    epochs = 30 if key != "compact_at_will" else 60
    curves = tuple(
        TrainingCurve(i, 1.4 * np.exp(-np.arange(epochs) / 6) + rng.gamma(1, 0.02, epochs), 240.0 + i, 460.0 + i)
        for i in range(runs)
    )
    results = tuple(tested(rng, split, a, runs, pose=key != "two_layer") for split, a in accuracies.items())
    return NetworkResult(
        key=key,
        label=label,
        description="Two convolutions and three fully connected layers.",
        trained_on="It learned from 1,270 pictures.",
        parameters=9_976_918,
        training=curves,
        tests=results,
        pictures=1270,
        phrase="the compact network trained on views at will" if key == "compact_at_will" else None,
    )


def splits(rng: np.random.Generator) -> tuple[Split, ...]:
    def pair(distance_mm: float, angle_deg: float) -> NearestPair:
        one = images(rng, 2)
        return NearestPair(one[0], one[1], distance_mm, angle_deg)

    return (
        Split(
            "published",
            "published split",
            "Drawn from the same trajectories.",
            150,
            True,
            rng.gamma(2, 0.2, 150),
            rng.gamma(2, 0.5, 150),
            pair(0.4, 0.8),
            "on the published split",
        ),
        Split(
            "trajectory",
            "unseen trajectories",
            "From trajectories of their own.",
            150,
            False,
            2 + rng.gamma(2, 1.2, 150),
            rng.gamma(3, 6, 150),
            pair(4.1, 17),
        ),
        Split(
            "trajectory_texture",
            "unseen trajectories, textures and lights",
            "And another texture and light.",
            150,
            False,
            2 + rng.gamma(2, 1.2, 150),
            rng.gamma(3, 6, 150),
            pair(4.3, 12),
        ),
    )


def prediction(probabilities: list[float]) -> Prediction:
    return Prediction("paper", NAMES, np.log(np.array(probabilities)))


def make_reproduce(anatomy: Anatomy, pictures: np.ndarray) -> ReportData:
    rng = np.random.default_rng(1)
    y = np.linspace(-36, 20, 60)
    lines = (
        Line("trajectory 1", "training", np.stack([0.5 * np.sin(y / 9), y, 2 + 0 * y], axis=1)),
        Line("trajectory 2", "test", np.stack([-1 + 0 * y, y, -3 + 2 * np.sin(y / 7)], axis=1)),
    )
    sets = tuple(
        ViewSet(title, caption, tuple(pictures[4 * i : 4 * i + n] for i, n in enumerate((4, 4, 3, 4))))
        for title, caption in (("Training pictures", "With the texture of the paper."), ("Unseen", "Other walls."))
    )
    return ReportData(
        kind="reproduce",
        title="Naming the region of the nose from one endoscopic picture",
        command="naris reproduce --anatomy ASR.ply --texture sampled_texture.jpg",
        made="2018-01-02T03:04:05Z",
        anatomy=AnatomyView(anatomy, "paper", "the published texture", lines),
        splits=splits(rng),
        networks=(
            network(
                rng,
                "two_layer",
                "two-layer",
                {"published": 0.86, "trajectory": 0.27, "trajectory_texture": 0.24},
                5,
            ),
            network(rng, "compact", "compact", {"published": 0.93, "trajectory": 0.58, "trajectory_texture": 0.52}, 5),
            network(rng, "compact_at_will", "compact, views at will", {"trajectory_texture": 0.945}, 1),
        ),
        views=sets,
        located=(
            LocatedFrame("view 12", pictures[0], prediction([0.9, 0.08, 0.01, 0.01]), True, 0, 1.8, 6.0),
            LocatedFrame("view 40", pictures[1], prediction([0.1, 0.3, 0.55, 0.05]), True, 1, 7.7, 21.0),
            LocatedFrame("view 77", pictures[2], prediction([0.25, 0.25, 0.26, 0.24]), False, 3),
        ),
        published=SINHA_2018,
        settings={
            "training": {"optimiser": "Adam", "rate": {"start": 0.001, "end": 0.0001}},
            "camera": {"fov_deg": 45},
        },
        stages=(Stage("simulate", "1,570 pictures", 41.0, 80.0), Stage("train: two-layer", "5 runs", 2400.0, 4600.0)),
        machine={"processor": "a processor", "cores": 2, "memory_gib": 24.0},
        versions={"naris": "0.1.0", "python": "3.11.0"},
        commit="0123456789abcdef",
        seed=7,
    )


@pytest.fixture(scope="session")
def reproduce_data() -> ReportData:
    """A full report: three networks, three splits, five runs."""
    return make_reproduce(tube(), images(np.random.default_rng(5), 16))


@pytest.fixture(scope="session")
def bare_data(reproduce_data: ReportData) -> ReportData:
    """The least there can be: one network, one run, one split, nothing else."""
    rng = np.random.default_rng(3)
    only = network(rng, "two_layer", "two-layer", {"trajectory": 0.7}, 1)
    run = replace(only.tests[0].runs[0], calibration=None, pose=None)
    test = TestResult("trajectory", (run,))
    split = Split("trajectory", "unseen trajectories", "From trajectories of their own.", 150, False)
    return ReportData(
        kind="demo",
        title="Bare",
        command="naris demo",
        made="2018-01-02T03:04:05Z",
        anatomy=AnatomyView(reproduce_data.anatomy.anatomy, "paper"),
        splits=(split,),
        networks=(replace(only, training=(), tests=(test,)),),
    )
