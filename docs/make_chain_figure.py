"""Draws `figures/chain.png` of `chain.md` from `benchmarks/results/chain.json`.

python docs/make_chain_figure.py [RESULT]     another record than the committed one
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

import matplotlib

from naris.bench.result import BenchResult, read_result

matplotlib.use("Agg")
import matplotlib.pyplot as plt

HERE = Path(__file__).resolve().parent
RESULT = HERE.parent / "benchmarks" / "results" / "chain.json"
FIGURE = HERE / "figures" / "chain.png"
TOLD = {
    "": "regions and poses\nof the compact network",
    ".regions": "its regions alone",
    ".hard": "its likeliest region as if sure",
    ".two_layer": "regions of the\ntwo-layer network",
    ".true": "the true region",
    ".none": "nothing",
    ".truth": "the true pose",
}
NOISES = {"b": "b: depth off by 5 % and 0.3 mm", "c": "c: the same, scale unknown"}
COLOURS = {"right": "#2b6a4d", "right, refused": "#a9cfb8", "wrong, refused": "#d9d9d9", "wrong, accepted": "#b5423c"}


@dataclass(frozen=True)
class Shares:
    """Of all frames; they add up to 1, in the order of `COLOURS`.

    Attributes:
        interval: 95 % of the first.
    """

    each: tuple[float, float, float, float]
    interval: tuple[float, float]


def main(arguments: list[str]) -> int:
    """Draws it; exit status 1 where there is no record."""
    path = Path(arguments[0]) if arguments else RESULT
    if not path.is_file():
        print(f"no record at {path}: run naris bench chain --out {path}", file=sys.stderr)
        return 1
    draw(read_result(path), FIGURE)
    print(f"written: {FIGURE.name}")
    return 0


def shares(result: BenchResult, name: str) -> Shares:
    """What became of the frames under `register.chain.<noise>[.<belief>]`."""
    value = {part: result.figure(f"{name}.{part}").value or 0.0 for part in ("tre_lt2", "refused", "accepted_wrong")}
    right = value["tre_lt2"]
    doubted = (result.figure(f"{name}.likeliest_lt2").value or 0.0) - right
    interval = result.figure(f"{name}.tre_lt2").interval or (right, right)
    return Shares((right, doubted, value["refused"] - doubted, value["accepted_wrong"]), interval)


def draw(result: BenchResult, out: Path) -> None:
    """Bars of every belief, a panel for each noise."""
    figure, axes = plt.subplots(1, len(NOISES), figsize=(10.5, 4.2), sharey=True, layout="constrained")
    for axis, (noise, told) in zip(axes, NOISES.items(), strict=True):
        for row, belief in enumerate(TOLD):
            found, left = shares(result, f"register.chain.{noise}{belief}"), 0.0
            for share, (label, colour) in zip(found.each, COLOURS.items(), strict=True):
                axis.barh(row, share, left=left, color=colour, height=0.7, label=label if row == 0 else None)
                left += share
            axis.plot(found.interval, (row, row), color="black", linewidth=1.2)
        goal = result.figure(f"register.chain.{noise}.tre_lt2").goal
        axis.axvline(goal, color="black", linestyle=":", linewidth=1)
        axis.set(title=told, xlim=(0, 1), xlabel="share of all frames")
    axes[0].set_yticks(range(len(TOLD)), list(TOLD.values()))
    axes[0].invert_yaxis()
    frames = result.figure("register.chain.b.tre_lt2").n
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(COLOURS), frameon=False)
    figure.suptitle(
        f"What the registration was told, and what came of it ({frames} frames; {result.inputs['patients']})"
    )
    figure.savefig(out, dpi=110)
    plt.close(figure)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
