"""Measure the figures that the documents quote, with goals, peers, machine and versions."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from naris.bench import BENCHMARKS
from naris.cli.console import Console
from naris.cli.options import IfGiven, refuse
from naris.errors import InputError

if TYPE_CHECKING:
    from naris.bench.result import BenchResult, Figure


@dataclass(frozen=True)
class Options:
    """What to measure, and how long to take."""

    name: Annotated[
        tyro.conf.Positional[str],
        tyro.conf.arg(
            metavar="{" + ",".join(BENCHMARKS) + "}",
            help="; ".join(f"{name}: {benchmark.summary}" for name, benchmark in BENCHMARKS.items()) + ".",
        ),
    ]
    quick: bool = False
    """At most 60 s on two cores, with fewer trials."""
    anatomy: Annotated[IfGiven[str], tyro.conf.arg(metavar="FILE|builtin")] = None
    """What to measure on; by default the published mean nose (naris fetch mean-nose). Not for anatomy, register,
    chain and demo, which have their own."""
    texture: Annotated[IfGiven[Path], tyro.conf.arg(metavar="FILE")] = None
    """A picture that colours the walls; by default that of the mean nose. Not for anatomy,
    register, chain and demo."""
    scans: Annotated[IfGiven[Path], tyro.conf.arg(metavar="DIR")] = None
    """Real data for the benchmarks anatomy, chain and register: a folder with nasalseg-p001/P001_img.nrrd and
    P001_seg.nrrd (case P001 of NasalSeg) and ct-head/ct_head.nii.gz (of the Python package dicom2stl), or with
    registration-trials/trials.npz, mean-nose/ASR.ply and cissticp/ (test_data of cisstICP); figures of those that are
    missing have no value."""
    only: Annotated[IfGiven[str], tyro.conf.arg(metavar="PART")] = None
    """Measure one part alone; of register: trials, cissticp (clouds to a surface, seconds), peers,
    deformable (a mean nose whose shape is estimated, a quarter of an hour), contours (edges and shading of a frame),
    pictures (a picture alone, half an hour) or shot (a real shot of another person, by pictures and by points)."""
    patients: IfGiven[int] = None
    """How many virtual patients, of chain; 20 when not given. With --work, more can follow later."""
    fit_steps: IfGiven[int] = None
    """Batches that each patient's network learns from, of chain; 3000 when not given, about five minutes."""
    seed: int = 0
    """Of everything random."""
    work: Annotated[IfGiven[Path], tyro.conf.arg(metavar="DIR")] = None
    """Where benchmarks write; by default a temporary folder. Only reproduce and chain keep it, and go on there
    later."""
    out: Annotated[IfGiven[Path], tyro.conf.arg(aliases=["-o"], metavar="FILE")] = None
    """Write the result there too, as JSON."""


def run(options: Options, console: Console) -> int:
    """Measures, writes and tells the figures."""
    from naris.bench import BenchRequest, run_benchmark
    from naris.core.atomic import check_writable, write_json

    if options.name in ("anatomy", "chain", "demo", "register"):
        refuse(options, ("anatomy", "texture"), "only with another benchmark", options.name)
    if options.name in ("render", "register"):
        refuse(options, ("work",), "only with a benchmark that writes", options.name)
    if options.name != "chain":
        refuse(options, ("patients", "fit_steps"), "only with the benchmark chain", options.name)
    if options.name not in ("anatomy", "chain", "register"):
        refuse(options, ("scans",), "only with the benchmarks anatomy, chain and register", options.name)
    elif options.scans is not None and not options.scans.is_dir():
        raise InputError(f"a folder of scans at {options.scans}", "none", "check the path")
    request = BenchRequest(
        quick=options.quick,
        seed=options.seed,
        anatomy=options.anatomy,
        texture=options.texture,
        scans=options.scans,
        work=options.work,
        only=options.only,
        patients=options.patients,
        fit_steps=options.fit_steps,
        progress=console.progress,
    )
    if options.out is not None:
        check_writable(options.out)  # before hours are spent on what cannot be kept
    result = run_benchmark(options.name, request, shlex.join(["naris", *sys.argv[1:]]))
    console.answer(result.record(), _told(result))
    if options.out is not None:
        write_json(options.out, result.record())
    return 0


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    if options.name not in ("chain", "reproduce"):
        return "nothing was kept, this benchmark begins anew each time"
    if options.work is None:
        return "nothing was kept; give --work DIR to go on another time"
    return f"what was made so far is in {options.work}; the same command goes on from there"


def _told(result: BenchResult) -> str:
    rows = [_row(figure) for figure in result.figures]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)] if rows else []
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    for figure in result.figures:
        for peer, value in figure.peers.items():
            said = _number(value, figure.unit) if isinstance(value, float) else value
            lines.append(f"  {figure.name} by {peer}: {said}")
    if result.seconds.wall is not None and result.seconds.cpu is not None:
        lines.append(f"{result.seconds.wall:.1f} s wall, {result.seconds.cpu:.1f} s CPU")
    return "\n".join(lines)


def _row(figure: Figure) -> tuple[str, ...]:
    value = "no value" if figure.value is None else _number(figure.value, figure.unit)
    goal = "" if figure.goal is None else f"goal {'≥' if figure.better == 'higher' else '≤'} {figure.goal:g}"
    verdict = {True: "reached", False: "missed", None: ""}[figure.reached]
    interval = "" if figure.interval is None else f"[{figure.interval[0]:.4g}, {figure.interval[1]:.4g}]"
    return figure.name, value, interval, goal, verdict, f"n = {figure.n}"


def _number(value: float, unit: str) -> str:
    digits = f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.4g}"
    return digits if unit == "1" else f"{digits} {unit}"
