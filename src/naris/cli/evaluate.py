"""How good is a model? Accuracy with its interval, confusion, calibration and pose errors on a data set."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from naris.cli.console import Console
from naris.cli.options import IfGiven, refuse

if TYPE_CHECKING:
    from naris.evaluate import Said, Summary
    from naris.model.checkpoint import Checkpoint

SCORES = "scores.json"
_PREDICTIONS = re.compile(r"predictions-\d+\.npz")


@dataclass(frozen=True)
class Options:
    """Which models, on which pictures."""

    models: Annotated[tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="MODEL…")]
    """Weights made by naris train: files or folders; a folder of several seeds gives one run each. Models that were
    trained alike but for the seed are runs of one network; others stand beside it."""
    data: Annotated[Path, tyro.conf.arg(aliases=["-d"], metavar="DATASET")]
    """Folder of naris simulate whose pictures the models have not seen, or the frame/ and pose/ folders of the
    published code."""
    out: Annotated[IfGiven[Path], tyro.conf.arg(aliases=["-o"], metavar="DIR")] = None
    """Keep what the models said (predictions-N.npz, read again next time) and the scores (scores.json) here: a new
    folder, or one of an evaluation before."""
    regions: Annotated[IfGiven[str], tyro.conf.arg(metavar="paper|FILE")] = None
    """Region set that labels the published code's poses: `paper` (its slabs) or a JSON file; by default that of the
    first model, if it knows the borders. A data set of naris simulate has its own."""
    by: Literal["position", "trajectory"] = "position"
    """What the interval resamples: the views of one position, or of one trajectory, are near-copies."""
    threads: Annotated[IfGiven[int], tyro.conf.arg(metavar="N")] = None
    """Of the network; by default as many as the library likes."""


def run(options: Options, console: Console) -> int:
    """Asks the models about every picture, or reads what they said before, and scores it."""
    from naris.cli.datasets import is_original, named_regions, open_dataset
    from naris.cli.folders import check_own
    from naris.cli.models import model_files
    from naris.core.atomic import write_json
    from naris.evaluate import export
    from naris.model.checkpoint import load_checkpoint
    from naris.model.localizer import open_localizer

    files = model_files(options.models)
    regions = None
    if is_original(options.data):
        regions = named_regions(options.regions) or load_checkpoint(files[0]).subject.borders
    else:
        refuse(options, ("regions",), "only with the published code's frame/ and pose/", f"{options.data}")
    dataset = open_dataset(options.data, regions)
    if options.out is not None:
        kept_before = {path.name for path in options.out.glob("predictions-*.npz") if _PREDICTIONS.fullmatch(path.name)}
        check_own(options.out, {SCORES, *kept_before}, "an evaluation")
    kinds: dict[str, _Network] = {}
    with console.progress.task("evaluate", len(files)) as advance:
        for number, file in enumerate(files):
            kept = None if options.out is None else options.out / f"predictions-{number}.npz"
            localizer = open_localizer(file)
            network = kinds.setdefault(_kind(localizer.checkpoint), _Network(localizer.checkpoint, [], []))
            network.files.append(file)
            network.said.append(export(localizer, dataset, kept, threads=options.threads))
            advance(1)
    networks = [network.told(options.by) for network in kinds.values()]
    data = {
        "data": str(options.data),
        "pictures": len(dataset),
        "anatomy": {"name": dataset.anatomy_name, "digest": dataset.anatomy_digest},
        "region_set": dataset.regions.name,
        "regions": list(dataset.regions.names),
        "resampled": options.by,
        "networks": [told for told, _ in networks],
    }
    if options.out is not None:
        write_json(options.out / SCORES, data)
    console.answer(data, "\n\n".join(_text(told, found, data, len(networks)) for told, found in networks))
    return 0


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    if options.out is None:
        return "nothing was kept; with -o DIR, what each model said is kept"
    return f"what the models before said is in {options.out}; the same command goes on from there"


@dataclass(frozen=True, eq=False)
class _Network:
    """Models that differ by their seed alone, the first of them, and what each said."""

    checkpoint: Checkpoint
    files: list[Path]
    said: list[Said]

    def told(self, by: Literal["position", "trajectory"]) -> tuple[dict[str, Any], Summary]:
        """As it is answered, and its figures."""
        from naris.evaluate import summary

        found = summary(self.said, by=by)
        about = {"network": self.checkpoint.network, "training": _settings(self.checkpoint).get("name")}
        return {**about, "models": [str(file) for file in self.files], **found.to_json()}, found


def _settings(checkpoint: Checkpoint) -> dict[str, Any]:
    settings = checkpoint.training.get("settings")
    return settings if isinstance(settings, dict) else {}


def _kind(checkpoint: Checkpoint) -> str:
    """The same for runs of one experiment: the network, how it was trained but for the seed, and on what."""
    from naris.core.provenance import digest

    ran = ("seed", "threads", "state_every_s")
    settings = {key: value for key, value in _settings(checkpoint).items() if key not in ran}
    start = (checkpoint.training.get("start") or {}).get("weights")
    made_for = checkpoint.subject.identity()
    return digest([checkpoint.network, checkpoint.config, settings, checkpoint.training.get("data"), start, made_for])


def _text(told: dict[str, Any], found: Summary, data: dict[str, Any], networks: int) -> str:
    low, high = (100 * end for end in found.interval)
    spread = "" if found.std is None else f" ± {100 * found.std:.1f} over {len(found.scores)} runs"
    first, several = found.scores[0], len(found.scores) > 1
    far = found.nonneighbour_error
    trained = f", {told['training']}" if told["training"] else ""
    lines = [
        *([f"{told['network']}{trained} ({', '.join(told['models'])}):"] if networks > 1 else []),
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
    return "\n".join(
        [*lines, "", *(["all runs together:"] if several else []), *_confusion(data["regions"], told["scores"])]
    )


def _confusion(names: Sequence[str], scores: Sequence[dict[str, Any]]) -> list[str]:
    """The counts of all runs: the true region by row, the answer by column."""
    runs = [one["confusion"] for one in scores]
    counts = [[sum(run[i][j] for run in runs) for j in range(len(names))] for i in range(len(names))]
    width = max(map(len, names))
    cell = max(len(str(max(map(max, counts)))), len(str(len(names)))) + 2
    head = " " * (width + 5) + "".join(f"{j + 1:>{cell}}" for j in range(len(names)))
    rows = [
        f"{i + 1:>3}  {name:<{width}}" + "".join(f"{count:>{cell}}" for count in counts[i])
        for i, name in enumerate(names)
    ]
    return ["true region by row, answer by column:", head, *rows]
