"""See it work: a nose, pictures of it, a network that learns its way there, and a report. About five minutes on two
cores.
"""

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
    from naris.report.data import NetworkResult, ReportData


@dataclass(frozen=True)
class Options:
    """Where to, and how long to train."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="DIR")] = Path("out/demo")
    """Folder of the pictures, the networks and the report: new, or one that this very command began."""
    budget_s: IfGiven[float] = None
    """Seconds of training of the compact network, more is better; what is left of five minutes when not given."""
    seed: int = 0
    """Of everything random."""


def run(options: Options, console: Console) -> int:
    """Runs the demo, or what is still missing of it."""
    from naris.bench.extract import demo_figures
    from naris.cli.experiments import finish
    from naris.demo import DemoConfig, demo

    command = shlex.join(["naris", *sys.argv[1:]])
    config = DemoConfig(budget_s=options.budget_s, seed=options.seed)
    data = demo(options.out, config, command=command, progress=console.progress)
    answer = finish(data, lambda seconds: demo_figures(data, seconds.wall), options.out)
    console.answer(answer, _told(data, answer["seconds"]["wall"], options.out))
    return 0


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    return f"what was made so far is in {options.out}; the same command goes on from there"


def _model(network: NetworkResult, out: Path) -> Path:
    """The folder of its first run."""
    return out / network.key / f"seed-{network.training[0].seed}" if network.training else out / network.key


def _told(data: ReportData, wall_s: float | None, out: Path) -> str:
    from naris.cli.experiments import REPORT, percent
    from naris.demo import FEW_PICTURES

    compact, two_layer = data.networks[0], data.networks[-1]
    hardest = data.splits[-1]
    ours, theirs = compact.test(hardest.key), two_layer.test(hardest.key)
    pose = ours.pose if ours else None
    where = "" if pose is None else f"; camera found to {pose.median_mm:.1f} mm and {pose.median_deg:.0f}° (median)"
    located = sum(frame.localised for frame in data.located)
    right = sum(frame.localised and frame.prediction.region == frame.truth for frame in data.located)
    took = "" if wall_s is None else f"; {wall_s:.0f} s in all"
    lines = [
        f"{hardest.label}: the compact network names {percent(ours) if ours else '–'} of the four regions{where}",
        f"the published two-layer network, on far fewer pictures than in the publication: "
        f"{percent(theirs) if theirs else '–'}",
        f"of {len(data.located)} test pictures drawn at random {located} localised, {right} in the right region{took}",
        f"report: {out / REPORT}; to use the network: naris locate PICTURE -m {_model(compact, out)}",
    ]
    if compact.pictures is not None and compact.pictures < FEW_PICTURES:
        lines.insert(
            1,
            f"  few pictures: it was shown {compact.pictures:,} in its time, on a free machine twice {FEW_PICTURES:,} "
            "or more; with more time (--budget-s) it names more regions",
        )
    return "\n".join(lines)
