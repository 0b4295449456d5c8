"""How good is a model? Accuracy with its interval, confusion, calibration and pose errors on a data set."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from naris.cli.console import Console
from naris.cli.options import IfGiven

if TYPE_CHECKING:
    from naris.evaluate import Summary

SCORES = "scores.json"


@dataclass(frozen=True)
class Options:
    """Which models, on which pictures."""

    models: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="MODEL…")]
    """Weights made by naris train: files or folders; a folder of several seeds gives one run each."""
    data: Annotated[Path, tyro.conf.arg(aliases=["-d"], metavar="DATASET")]
    """Folder of naris simulate whose pictures the models have not seen."""
    out: Annotated[IfGiven[Path], tyro.conf.arg(aliases=["-o"], metavar="DIR")] = None
    """Keep what the models said (predictions-N.npz, read again next time) and the scores (scores.json) here."""
    by: Literal["position", "trajectory"] = "position"
    """What the interval resamples: the views of one position, or of one trajectory, are near-copies."""
    threads: Annotated[IfGiven[int], tyro.conf.arg(metavar="N")] = None
    """Of the network; by default as many as the library likes."""


def run(options: Options, console: Console) -> int:
    """Asks the models about every picture, or reads what they said before, and scores it."""
    from naris.cli.models import model_files
    from naris.core.atomic import write_json
    from naris.dataset.read import Dataset
    from naris.evaluate import export, summary

    files = model_files(options.models)
    dataset = Dataset.open(options.data)
    said = []
    with console.progress.task("evaluate", len(files)) as advance:
        for number, file in enumerate(files):
            kept = None if options.out is None else options.out / f"predictions-{number}.npz"
            said.append(export(file, dataset, kept, threads=options.threads))
            advance(1)
    found = summary(said, by=options.by)
    data = {
        "data": str(options.data),
        "pictures": len(dataset),
        "anatomy": {"name": dataset.anatomy_name, "digest": dataset.anatomy_digest},
        "region_set": dataset.regions.name,
        "regions": list(dataset.regions.names),
        "models": [str(file) for file in files],
        "resampled": options.by,
        **found.to_json(),
    }
    if options.out is not None:
        write_json(options.out / SCORES, data)
    console.answer(data, _text(found, data))
    return 0


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    if options.out is None:
        return "nothing was kept; with -o DIR, what each model said is kept"
    return f"what the models before said is in {options.out}; the same command goes on from there"


def _text(found: Summary, data: dict[str, Any]) -> str:
    low, high = (100 * end for end in found.interval)
    spread = "" if found.std is None else f" ± {100 * found.std:.1f} over {len(found.scores)} runs"
    first, several = found.scores[0], len(found.scores) > 1
    far = found.nonneighbour_error
    lines = [
        f"accuracy {100 * found.mean:.1f} %{spread} (95 % interval {low:.1f}–{high:.1f}), "
        f"{first.pictures} pictures of {first.clusters} {data['resampled']} clusters",
        "no wrong answers"
        if far is None
        else f"{100 * far:.1f} % of wrong answers name a region that does not touch the true one",
        *(["the first of them (--json tells all):"] if several else []),
        f"calibration error {first.reliability.ece:.3f}"
        + ("" if first.refused is None else f"; {100 * first.refused:.1f} % seen as none of the training's kind"),
    ]
    if first.pose is not None:
        lines.append(
            f"camera off by {first.pose.median_mm:.1f} mm and {first.pose.median_deg:.1f}° (medians), "
            f"{100 * first.pose.near:.0f} % within 4 mm and 15°"
        )
    return "\n".join([*lines, "", *(["all runs together:"] if several else []), *_confusion(data)])


def _confusion(data: dict[str, Any]) -> list[str]:
    """The counts of all runs: the true region by row, the answer by column."""
    names, runs = data["regions"], [one["confusion"] for one in data["scores"]]
    counts = [[sum(run[i][j] for run in runs) for j in range(len(names))] for i in range(len(names))]
    width = max(map(len, names))
    cell = max(len(str(max(map(max, counts)))), len(str(len(names)))) + 2
    head = " " * (width + 5) + "".join(f"{j + 1:>{cell}}" for j in range(len(names)))
    rows = [
        f"{i + 1:>3}  {name:<{width}}" + "".join(f"{count:>{cell}}" for count in counts[i])
        for i, name in enumerate(names)
    ]
    return ["true region by row, answer by column:", head, *rows]
