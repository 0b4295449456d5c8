"""What `naris demo` and `naris reproduce` share: writing the report and the figures, and telling them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from naris.bench.result import BenchResult, Figure, Seconds
from naris.core.atomic import write_json
from naris.experiment import stages
from naris.experiment.stages import Journal
from naris.report.data import ReportData
from naris.report.scores import TestResult
from naris.report.write import write_report

REPORT, FIGURES = "report.html", "figures.json"


def finish(data: ReportData, figures: Callable[[Seconds], tuple[Figure, ...]], out: Path) -> dict[str, Any]:
    """Write `report.html` and `figures.json`, and give what `--json` prints.

    Args:
        data: of an experiment in `out`.
        figures: of it, given how long all stages took over all calls, this one included.
        out: its folder.

    Raises:
        DiskFull: if there is no room.
    """
    journal = Journal.open(out)
    with journal.stage(stages.REPORT):
        report = write_report(data, out / REPORT)
    seconds = Seconds(*journal.in_all())
    anatomy = data.anatomy.anatomy
    result = BenchResult(
        command=data.command,
        commit=data.commit,
        machine=data.machine,
        versions=data.versions,
        seed=data.seed,
        seconds=seconds,
        figures=figures(seconds),
        inputs={"anatomy": f"{anatomy.name}, digest {anatomy.digest}"},
    ).record()
    write_json(out / FIGURES, result)
    return {"report": report, "figures_file": out / FIGURES, **result}


def percent(test: TestResult) -> str:
    """`86.0 %`, or `86.0 ± 1.2 %` over several runs."""
    spread = "" if test.std is None else f" ± {100 * test.std:.1f}"
    return f"{100 * test.mean:.1f}{spread} %"
