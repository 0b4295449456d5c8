"""Benchmarks: `naris bench NAME` measures figures with goals and peers.

A benchmark is a module with `measure(request: BenchRequest) -> Measurement`; it is imported when it runs.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from naris.bench.result import BenchResult, Figure, Seconds
from naris.core.progress import SILENT, Progress
from naris.errors import InputError


class Benchmark(NamedTuple):
    """Where a benchmark lives, what it measures, in a few words, and the parts that can be measured alone."""

    module: str
    summary: str
    parts: tuple[str, ...] = ()


BENCHMARKS: Mapping[str, Benchmark] = {
    "render": Benchmark("naris.bench.render", "speed of the renderer beside others, and whether it is right"),
    "simulate": Benchmark("naris.bench.simulate", "seconds for 1,420 pictures on disk"),
    "anatomy": Benchmark("naris.bench.anatomy", "noses found in simulated and real CTs beside the truth"),
    "register": Benchmark(
        "naris.bench.register",
        "how often, how surely and at what cost a registration ends right",
        ("trials", "cissticp", "peers", "deformable", "contours", "pictures", "shot"),
    ),
    "chain": Benchmark("naris.bench.chain", "frame in and pose out: each patient's own network starts a registration"),
    "viewer": Benchmark("naris.bench.viewer", "how soon, how smooth and how true naris steer is in a browser"),
    "demo": Benchmark("naris.bench.demo", "what naris demo comes to, and its seconds"),
    "reproduce": Benchmark("naris.bench.reproduce", "the published experiment, every network on every split"),
}
"""Every benchmark that works."""


@dataclass(frozen=True)
class BenchRequest:
    """What every benchmark is told.

    Attributes:
        quick: finish within 60 s on two cores, with fewer trials (and say so in each figure's `n`).
        seed: of everything random.
        anatomy: a surface file or a saved anatomy, the word `builtin`, or None for what the benchmark is defined on.
        texture: a picture for the walls, or None.
        scans: a folder with real scans for `anatomy` and `chain` and frozen trials for `register`, or None.
        work: a folder to write in, that `reproduce` and `chain` keep and take up again; None for a temporary one.
        only: the one part to measure, or None for all.
        patients: how many virtual patients `chain` measures, or None for all.
        fit_steps: how long each patient's network learns in `chain`, or None for what the benchmark is defined on.
        progress: where long work reports to.
    """

    quick: bool = False
    seed: int = 0
    anatomy: str | None = None
    texture: Path | None = None
    scans: Path | None = None
    work: Path | None = None
    only: str | None = None
    patients: int | None = None
    fit_steps: int | None = None
    progress: Progress = SILENT

    def wants(self, part: str) -> bool:
        """Whether that part is to be measured."""
        return self.only in (None, part)


@dataclass(frozen=True)
class Measurement:
    """What a benchmark gives back: its figures, and what they were measured on (role → name and digest)."""

    figures: tuple[Figure, ...]
    inputs: Mapping[str, str] = field(default_factory=dict)


def run_benchmark(name: str, request: BenchRequest, command: str) -> BenchResult:
    """Measures, and adds how it was measured.

    Raises:
        InputError: if there is no benchmark of that name, or no such part of it.
    """
    from naris.core import provenance

    if name not in BENCHMARKS:
        raise InputError(f"one of the benchmarks {sorted(BENCHMARKS)}", repr(name), "name one of those")
    parts = BENCHMARKS[name].parts
    if request.only is not None and request.only not in parts:
        known = f"one of the parts {', '.join(parts)} of {name}" if parts else f"{name} as a whole: it has no parts"
        raise InputError(known, repr(request.only), "name one of those" if parts else "leave out the part")
    module = importlib.import_module(BENCHMARKS[name].module)
    with provenance.Stopwatch() as watch:
        measurement: Measurement = module.measure(request)
    return BenchResult(
        command=command,
        commit=provenance.commit(),
        machine=provenance.machine(),
        versions=provenance.versions(),
        seed=request.seed,
        seconds=Seconds(watch.wall_s, watch.cpu_s),
        figures=measurement.figures,
        inputs=measurement.inputs,
    )
