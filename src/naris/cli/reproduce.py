"""Run the experiment of Sinha et al. 2018 and what it leaves open; a stopped run goes on where it was."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from naris.cli.console import Console
from naris.cli.options import IfGiven

if TYPE_CHECKING:
    from naris.report.data import ReportData


@dataclass(frozen=True)
class Options:
    """On what, and how much of it."""

    anatomy: Annotated[str, tyro.conf.arg(metavar="ANATOMY")]
    """The published mean nose (ASR.ply of naris fetch mean-nose), or any other anatomy with a texture."""
    texture: Annotated[Path, tyro.conf.arg(metavar="FILE")]
    """The picture that colours the walls (sampled_texture.jpg of naris fetch mean-nose)."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="DIR")] = Path("out/reproduce")
    """Folder of the pictures, the networks and the report: new, or one that this very command began."""
    regions: Annotated[IfGiven[str], tyro.conf.arg(metavar="NAME|FILE|slabs")] = None
    """Region set; by default the anatomy's first (the paper's four slabs for the mean nose)."""
    epochs: int = 30
    """Of the two-layer network."""
    runs: int = 5
    """Of the two-layer network, and of the compact one on the same pictures."""
    compact_epochs: int = 40
    """Of the compact network on the same pictures."""
    at_will_steps: int = 6000
    """Batches of 64 views at will for the compact network."""
    workers: int = 2
    """Runs at a time, each on one thread."""
    seed: int = 0
    """Of the views and looks."""


def run(options: Options, console: Console) -> int:
    """Runs the experiment, or what is still missing of it."""
    from naris.bench.extract import reproduce_figures
    from naris.cli.anatomies import open_anatomy
    from naris.cli.experiments import finish
    from naris.reproduce import ReproduceConfig, reproduce

    config = ReproduceConfig(
        epochs=options.epochs,
        runs=options.runs,
        compact_epochs=options.compact_epochs,
        compact_runs=options.runs,
        at_will_steps=options.at_will_steps,
        workers=options.workers,
        seed=options.seed,
    )
    command = shlex.join(["naris", *sys.argv[1:]])
    anatomy, regions = open_anatomy(options.anatomy, options.regions)
    anatomy = anatomy.with_(regions={regions.name: regions})
    data = reproduce(anatomy, options.texture, options.out, config, command=command, progress=console.progress)
    answer = finish(data, lambda seconds: reproduce_figures(data), options.out)
    console.answer(answer, _told(data, options.out))
    return 0


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    return f"what was made so far is in {options.out}; the same command goes on from there"


def _told(data: ReportData, out: Path) -> str:
    from naris.cli.experiments import REPORT, percent

    lines = []
    for network in data.networks:
        lines.append(network.label)
        lines += [f"  {data.split(test.split).label}: {percent(test)}" for test in network.tests]
    if data.published is not None:
        told = data.published
        lines.append(f"published: {100 * told.accuracy:.2f} ± {100 * told.std:.2f} %")
    lines.append(f"report: {out / REPORT}")
    return "\n".join(lines)
