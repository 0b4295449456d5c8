"""What the benchmark of registrations says of itself."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from naris.bench import register as room
from naris.bench.register import SEARCH, Outcome, of_which_solver, solver_digest
from naris.core.pose import CAMERA, Pose
from naris.core.results import Registration


def outcome(off_mm: float, *, refused: bool = False, landmarks_mm: float | None = None) -> Outcome:
    pose = Pose(np.eye(4), "LPS", CAMERA)
    found = Registration(
        anatomy_T_camera=None if refused else pose,
        best=pose,
        status="refused" if refused else "registered",
        reason="why" if refused else None,
        probability=0.5,
        scale=1.0,
        cost=0.0,
        margin=1.0,
        covariance=np.eye(6),
        alternatives=pose.reshape(1),
    )
    return Outcome(off_mm, 1.0, 0.1, found, 1.0, landmarks_mm)


def test_a_refused_pose_that_is_right_is_a_success_and_no_answer() -> None:
    done = [outcome(0.5), outcome(1.5, refused=True), outcome(9.0), outcome(9.0, refused=True)]
    made = {one.name: one for one in room._of("some", done, "region", "b")}
    assert (made["some.success"].value, made["some.close"].value) == (0.5, 0.25)
    assert (made["some.answered"].value, made["some.refused"].value) == (0.25, 0.5)
    assert made["some.success"].goal == 0.85
    assert "some.landmarks_tre_median_mm" not in made


def test_errors_at_landmarks_are_of_those_that_have_some() -> None:
    made = room._of("some", [outcome(0.5, landmarks_mm=1.0), outcome(0.5, landmarks_mm=3.0)], "none", "b")
    assert (made[-1].name, made[-1].value, made[-1].n) == ("some.landmarks_tre_median_mm", 2.0, 2)


def test_rates_are_of_those_that_were_accepted() -> None:
    made = room._rate("some", np.array([True, False, False, False]))
    assert (made.value, made.n) == (0.25, 4)
    assert made.interval is not None
    assert made.interval[0] < 0.25 < made.interval[1]
    none = room._rate("some", np.zeros(0, bool))
    assert (none.value, none.n) == (None, 0)


def test_a_confidence_of_another_solver_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name in (*SEARCH, "confidence"):
        (tmp_path / f"{name}.py").write_text(name)
    monkeypatch.setattr(room.resources, "files", lambda _: tmp_path)
    (tmp_path / room.FITTED).write_text(json.dumps({"solver": solver_digest()}))
    assert of_which_solver().startswith("fitted on this solver")
    (tmp_path / "solve.py").write_text("changed")
    assert of_which_solver().startswith("fitted on another solver")


def test_the_confidence_is_that_of_the_solver_as_it_is() -> None:
    """Whoever changes the solver fits it anew (docs/make_confidence.py): probabilities of another one mislead."""
    assert of_which_solver().startswith("fitted on this solver")
