"""How the demo divides its time; what it makes is tested with its command."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from naris.demo import BUDGET, DemoConfig, _budget_s
from naris.errors import InputError
from naris.experiment.stages import Journal


def test_training_gets_what_the_other_stages_left_and_keeps_it_when_taken_up_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    journal, config = Journal.open(tmp_path, new=True), DemoConfig(within_s=300.0)
    monkeypatch.setattr(journal, "so_far_s", lambda: 50.0)
    first = _budget_s(config, tmp_path, journal)
    assert 200 < first < 250
    monkeypatch.setattr(journal, "so_far_s", lambda: 120.0)
    assert _budget_s(config, tmp_path, journal) == first
    (tmp_path / BUDGET).write_text("{")
    assert _budget_s(config, tmp_path, journal) == pytest.approx(first - 70)
    assert _budget_s(replace(config, budget_s=7.0), tmp_path, journal) == 7.0


def test_a_slow_machine_trains_for_a_minute_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    journal = Journal.open(tmp_path, new=True)
    monkeypatch.setattr(journal, "so_far_s", lambda: 1000.0)
    assert _budget_s(DemoConfig(), tmp_path, journal) == 60.0


@pytest.mark.parametrize("change", [{"budget_s": 0.0}, {"within_s": float("nan")}, {"within_s": -1.0}, {"located": 0}])
def test_impossible_amounts_are_refused(change: dict[str, float]) -> None:
    with pytest.raises(InputError, match="at least one"):
        replace(DemoConfig(), **change)  # type: ignore[arg-type]
