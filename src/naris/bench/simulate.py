"""How long it takes to simulate and write as many pictures as the published experiment had."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from naris.bench import BenchRequest, Measurement
from naris.bench.result import Figure
from naris.bench.subject import Subject, subject
from naris.core.camera import Intrinsics
from naris.core.provenance import Stopwatch
from naris.dataset.generate import Simulation, simulate
from naris.dataset.splits import SplitSizes, make_splits
from naris.render.viewpoints import Viewpoints, joined

GOAL_S = 60.0
SIZES = SplitSizes()
_CAMERA = Intrinsics.from_vertical_fov(300, 300, 45.0)


def measure(request: BenchRequest) -> Measurement:
    """Simulates the 1,270 training and 150 test pictures of 300×300 pixels with depth, and writes them.

    The anatomy, its passages and the views are made before the clock starts (`simulate.prepare.seconds`); building the
    scene, rendering, encoding and writing are timed. `--quick` does the same: it takes well below a minute.
    """
    with Stopwatch() as prepare:
        what = subject(request)
        views = _views(what, request.seed)
    with tempfile.TemporaryDirectory(dir=request.work, prefix="bench-simulate-") as folder, Stopwatch() as watch:
        simulation = Simulation(
            anatomy=what.anatomy,
            regions=what.anatomy.region_set(),
            views=views,
            intrinsics=_CAMERA,
            appearance=what.appearance,
            seed=request.seed,
        )
        count = len(simulate(simulation, Path(folder) / "data", progress=request.progress))
    return Measurement(
        (
            Figure(f"simulate.{count}.seconds", watch.wall_s, "s", count, "lower", GOAL_S),
            Figure(f"simulate.{count}.cpu_seconds", watch.cpu_s, "s", count, "lower"),
            Figure("simulate.prepare.seconds", prepare.wall_s, "s", 1, "lower"),
        ),
        what.inputs,
    )


def _views(what: Subject, seed: int) -> Viewpoints:
    """The 1,420 views of the published experiment."""
    splits = make_splits(what.anatomy, what.anatomy.region_set(), np.random.default_rng(seed), SIZES)
    return joined([splits.train, splits.published])
