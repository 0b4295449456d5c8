"""What the benchmark of registrations says of itself."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from naris.bench import register as room
from naris.bench.register import SOLVER, of_which_solver, solver_digest


def test_rates_are_of_those_that_were_accepted() -> None:
    made = room._rate("some", np.array([True, False, False, False]))
    assert (made.value, made.n) == (0.25, 4)
    assert made.interval is not None
    assert made.interval[0] < 0.25 < made.interval[1]
    none = room._rate("some", np.zeros(0, bool))
    assert (none.value, none.n) == (None, 0)


def test_a_confidence_of_another_solver_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in SOLVER:
        (tmp_path / f"{name}.py").write_text(name)
    monkeypatch.setattr(room.resources, "files", lambda _: tmp_path)
    (tmp_path / room.FITTED).write_text(json.dumps({"solver": solver_digest()}))
    assert of_which_solver().startswith("fitted on this solver")
    (tmp_path / "solve.py").write_text("changed")
    assert of_which_solver().startswith("fitted on another solver")


def test_the_confidence_is_that_of_the_solver_as_it_is() -> None:
    """Whoever changes the solver fits it anew (docs/make_confidence.py): probabilities of another one mislead."""
    assert of_which_solver().startswith("fitted on this solver")
