"""The published experiment as figures: every network on every split, and how long the runs took."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

from naris.bench import BenchRequest, Measurement
from naris.bench.extract import reproduce_figures
from naris.bench.subject import subject
from naris.dataset.splits import SplitSizes
from naris.errors import InputError
from naris.reproduce import ReproduceConfig, reproduce
from naris.train.loop import RUN, by_other_code

QUICK = ReproduceConfig(
    sizes=SplitSizes(train_positions=24, test_positions=8),
    epochs=1,
    runs=2,
    compact_epochs=1,
    compact_runs=1,
    at_will_steps=20,
)
"""Everything once, in small: it shows that the experiment runs, its accuracies mean nothing."""


def measure(request: BenchRequest) -> Measurement:
    """Runs `naris reproduce` (with `--work DIR` it goes on there, and a finished one is only read).

    Raises:
        InputError: if there is no texture.
    """
    what = subject(request)
    if what.texture is None:
        raise InputError("the texture of the published experiment", "none", "naris fetch mean-nose, or give --texture")
    config = replace(QUICK if request.quick else ReproduceConfig(), seed=request.seed)
    with tempfile.TemporaryDirectory(prefix="naris-bench-reproduce-") as spare:
        out = request.work or Path(spare)
        data = reproduce(what.anatomy, what.texture, out, config, command="naris reproduce", progress=request.progress)
        return Measurement(reproduce_figures(data), {**what.inputs, **_older_trainings(out)})


def _older_trainings(out: Path) -> dict[str, str]:
    """Which trainings other code finished in an earlier call: this call only read their results."""
    older: dict[str, list[str]] = {}
    for run in sorted(out.glob(f"*/seed-*/{RUN}")):
        by = by_other_code(run.parent)
        if by is not None:
            older.setdefault(by, []).append(str(run.parent.relative_to(out)))
    return {f"trained by {by}": ", ".join(names) for by, names in older.items()}
