"""What `naris demo` comes to, and how long it takes with its report."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

from naris.bench import BenchRequest, Measurement
from naris.bench.extract import demo_figures
from naris.core.provenance import Stopwatch
from naris.demo import DemoConfig, demo
from naris.report.write import write_report

QUICK = DemoConfig(train_positions=24, test_positions=8, epochs=1, budget_s=10.0)
"""Everything once, in small: it shows that the demo runs, its accuracy means little."""


def measure(request: BenchRequest) -> Measurement:
    """Runs the demo from nothing, always in a folder of its own, and writes its report."""
    config = replace(QUICK if request.quick else DemoConfig(), seed=request.seed)
    with (
        tempfile.TemporaryDirectory(prefix="naris-bench-demo-", dir=request.work) as folder,
        Stopwatch() as watch,
    ):
        data = demo(Path(folder), config, progress=request.progress)
        write_report(data, Path(folder) / "report.html")
        seconds = watch.wall_s
    anatomy = data.anatomy.anatomy
    return Measurement(demo_figures(data, seconds), {"anatomy": f"{anatomy.name}, digest {anatomy.digest}"})
