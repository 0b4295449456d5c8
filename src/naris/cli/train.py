"""Train a network: on views of an anatomy rendered as it learns, or on a data set; a stopped training goes on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from naris.cli.console import Console
from naris.cli.options import IfGiven

if TYPE_CHECKING:
    from naris.train import TrainingRun


@dataclass(frozen=True)
class Options:
    """What to learn from, which network, for how long."""

    source: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="ANATOMY|DATASET")]
    """An anatomy (`builtin`, a surface file, a folder of naris anatomy): views are drawn anew for every batch. Or the
    folder of a data set: of naris simulate, or with the frame/ and pose/ of the published code."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="DIR")]
    """Folder of the training: new, or one that this very command began. The model is DIR/model.safetensors, with
    several seeds DIR/seed-N/model.safetensors."""
    network: Literal["compact", "two-layer"] = "compact"
    """compact: ours, region and pose; two-layer: that of Sinha et al. 2018, regions only."""
    epochs: IfGiven[int] = None
    """Passes through a data set; by default 60 (compact) or 30 (two-layer). On views of an anatomy, hundreds of
    batches."""
    steps: IfGiven[int] = None
    """Batches instead; by default 6000 on views of an anatomy."""
    budget_s: IfGiven[float] = None
    """Seconds of training instead; how far it gets then depends on the machine."""
    seeds: tuple[int, ...] = (0,)
    """Of the initial weights and the order of the pictures; several train one run each."""
    workers: IfGiven[int] = None
    """Runs at a time on a data set, each on one thread; one when not given. Only with several seeds, and not for views
    of an anatomy."""
    regions: Annotated[IfGiven[str], tyro.conf.arg(metavar="NAME|FILE|slabs")] = None
    """Region set of an anatomy to tell apart: one of its own, a JSON file, or four even slabs; by default its first.
    A data set of naris simulate has its own; for the published code's name `paper` (its slabs) or a JSON file."""
    views: IfGiven[Literal["inspection", "travel", "anywhere"]] = None
    """Which views of an anatomy: along the passages with some depth ahead (inspection, when not given), the same with
    each stretch of every passage equally often (travel), or from any place with room (anywhere). Not for a data set."""
    appearance: IfGiven[Literal["training", "unseen", "endoscope", "paper"]] = None
    """Look of the views of an anatomy; training, when not given: drawn for each, with texture, light, gain and noise at
    random. Not for a data set."""
    scopes: IfGiven[Literal["one", "many"]] = None
    """Cameras of the views of an anatomy; one, when not given; many: fields of view of 38–75 degrees, the axis a little
    off, for a model that shall read pictures of other scopes. Not for a data set."""
    fov_deg: IfGiven[float] = None
    """Vertical field of view of the one camera, in degrees; 45 when not given. Not for a data set, nor
    with many scopes."""


def run(options: Options, console: Console) -> int:
    """Trains, or goes on where a training was stopped."""
    from naris.cli.learning import carry_out

    runs = [_told(one) for one in carry_out(options, console.progress)]
    lines = [
        f"{one['model']}: {one['steps']} steps, region loss {_losses(one)}, {one['seconds']:.0f} s" for one in runs
    ]
    console.answer({"network": options.network, "source": options.source, "runs": runs}, "\n".join(lines))
    return 0


def _losses(run: dict[str, Any]) -> str:
    """Of the first and the last epoch, or of the only one."""
    first, last = f"{run['loss_first']:.2f}", f"{run['loss_last']:.2f}"
    return last if run["loss_first"] == run["loss_last"] else f"{first} → {last}"


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    return f"the state of the training is in {options.out}; the same command goes on from there"


def _told(run: TrainingRun) -> dict[str, Any]:
    return {
        "seed": run.seed,
        "model": str(run.checkpoint),
        "steps": run.steps,
        "pictures": run.pictures,
        "loss_first": round(float(run.loss[0]), 4),
        "loss_last": round(float(run.loss[-1]), 4),
        "seconds": round(run.wall_s, 2),
        "cpu_seconds": round(run.cpu_s, 2),
    }
