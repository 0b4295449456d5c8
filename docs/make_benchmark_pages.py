"""Writes `docs/benchmarks.md` and the figures in the pages `FILLED` from `benchmarks/results/*.json`.

    python docs/make_benchmark_pages.py            write them
    python docs/make_benchmark_pages.py --check    exit 1 if they are not what the results say

In a page, what stands between `<!-- figure NAME -->` and `<!-- end -->` is replaced by that figure with its interval,
and after `<!-- value NAME -->` by its value alone, for tables of many.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Mapping
from pathlib import Path

from naris.bench.result import BenchResult, Figure, read_result

DOCS = Path(__file__).resolve().parent
RESULTS = DOCS.parent / "benchmarks" / "results"
FILLED = ("chain.md", "published_experiment.md", "registration.md", "viewer.md")
MISSING = "not measured yet"
NONE_WRONG = "none wrong"
_MARK = re.compile(r"<!-- (?P<how>figure|value) (?P<name>\S+) -->.*?<!-- end -->", re.DOTALL)


def main(arguments: list[str]) -> int:
    """Writes or checks the pages; the exit status."""
    stale = []
    for path, text in pages(RESULTS, DOCS).items():
        if not path.is_file() or path.read_text(encoding="utf-8") != text:
            stale.append(path.name)
            if "--check" not in arguments:
                path.write_text(text, encoding="utf-8")
    if "--check" in arguments and stale:
        print(f"{', '.join(stale)} differ from benchmarks/results: run python docs/make_benchmark_pages.py")
        return 1
    print(f"written: {', '.join(stale)}" if stale else "nothing to do")
    return 0


def pages(results: Path, docs: Path) -> dict[Path, str]:
    """The text that every generated page should have."""
    read = {path.stem: read_result(path) for path in sorted(results.glob("*.json"))}
    figures = {figure.name: figure for result in read.values() for figure in result.figures}
    made = {docs / "benchmarks.md": benchmarks(read)}
    for name in FILLED:
        made[docs / name] = filled((docs / name).read_text(encoding="utf-8"), figures)
    return made


def filled(text: str, figures: Mapping[str, Figure]) -> str:
    """The text with every marked figure replaced by what was measured."""

    def replaced(match: re.Match[str]) -> str:
        figure, how = figures.get(match["name"]), match["how"]
        value = MISSING if figure is None else told(figure, with_interval=how == "figure")
        return f"<!-- {how} {match['name']} -->{value}<!-- end -->"

    return _MARK.sub(replaced, text)


def benchmarks(results: Mapping[str, BenchResult]) -> str:
    """The page of all results."""
    parts = [
        "# Benchmarks",
        "",
        "This page is generated from `benchmarks/results/*.json` by `python docs/make_benchmark_pages.py`. Each file",
        "was written by `naris bench NAME --out benchmarks/results/NAME.json` on the commit that it names, in full, or",
        "by the command that it names for a part that changed since; other pages take the figures of the part.",
        "With `--work DIR`, `reproduce` and `chain` read what an earlier call of these settings finished there; its",
        "own seconds are among the figures.",
        "`naris bench NAME --quick` measures the same with fewer trials in a minute.",
        "",
    ]
    for name, result in results.items():
        parts += section(name, result)
    if not results:
        parts += ["No results yet.", ""]
    return "\n".join(parts)


def section(name: str, result: BenchResult) -> list[str]:
    """One benchmark: how it was measured, its figures, its peers."""
    machine = result.machine
    where = f"{machine.get('processor', 'unknown processor')}, {machine.get('cores', '?')} cores"
    versions = ", ".join(f"{package} {version}" for package, version in result.versions.items())
    lines = [
        f"## {name}",
        "",
        f"`{result.command}` · commit {result.commit or 'unknown'} · seed {result.seed} · "
        f"{result.seconds.wall:.0f} s wall, {result.seconds.cpu:.0f} s CPU · {where}",
        "",
        *(f"- {role}: {what}" for role, what in result.inputs.items()),
        f"- {versions}",
        "",
        "| figure | value | 95 % interval | goal | n |",
        "|---|---|---|---|---|",
    ]
    lines += [row(figure) for figure in result.figures]
    peers = [
        f"- `{figure.name}` by {peer}: {value if isinstance(value, str) else number(value, figure.unit)}"
        for figure in result.figures
        for peer, value in figure.peers.items()
    ]
    return [*lines, "", *(["Peers in the same run:", "", *peers, ""] if peers else [])]


def row(figure: Figure) -> str:
    """One line of the table of figures."""
    interval = "–"
    if figure.interval is not None:
        low, high = (number(end, figure.unit) for end in figure.interval)
        interval = f"{low} … {high}"
    goal = "–"
    if figure.goal is not None:
        met = {True: "reached", False: "missed", None: MISSING}[figure.reached]
        goal = f"{'≥' if figure.better == 'higher' else '≤'} {number(figure.goal, figure.unit)}: {met}"
    value = no_value(figure) if figure.value is None else f"**{number(figure.value, figure.unit)}**"
    return f"| `{figure.name}` | {value} | {interval} | {goal} | {figure.n:,} |"


def told(figure: Figure, *, with_interval: bool = True) -> str:
    """A figure in running text."""
    if figure.value is None:
        return no_value(figure)
    text = number(figure.value, figure.unit)
    if figure.interval is None or not with_interval:
        return text
    low, high = (number(end, figure.unit) for end in figure.interval)
    return f"{text} ({low} … {high})"


def no_value(figure: Figure) -> str:
    """What stands for a figure without a value: a share of the wrong answers has none where nothing was wrong."""
    return NONE_WRONG if figure.name.endswith(".nonneighbour_error") and figure.n == 0 else MISSING


def number(value: float, unit: str) -> str:
    """A value with its unit; shares of one in per cent."""
    if unit == "1":
        return f"{100 * value:.1f} %"
    digits = f"{value:,.0f}" if abs(value) >= 1000 else f"{value:.3g}"
    return f"{digits} {unit}"


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
