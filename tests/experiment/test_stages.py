"""Whose a folder is, and how long the stages of an experiment took, over all calls that worked on them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from naris.errors import ConfigurationChanged, InputError
from naris.experiment import stages
from naris.experiment.claim import claim
from naris.experiment.stages import STAGES, Journal


class Clock:
    """Stands in for the stopwatch: each block takes the next of the given seconds, and a third more of CPU time."""

    def __init__(self, *seconds: float) -> None:
        self.left = list(seconds)

    def __call__(self) -> Clock:
        return self

    def __enter__(self) -> Clock:
        self.wall_s = self.left.pop(0)
        self.cpu_s = 4 * self.wall_s / 3
        return self

    def __exit__(self, *error: object) -> None:
        pass


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    clock = Clock(30.0, 60.0, 3.0, 1000.0)
    monkeypatch.setattr(stages, "Stopwatch", clock)
    return clock


def test_an_interrupted_stage_counts_all_its_parts_and_an_ended_one_no_more(tmp_path: Path, clock: Clock) -> None:
    journal = Journal.open(tmp_path, new=True)
    with pytest.raises(KeyboardInterrupt), journal.stage("train"):
        raise KeyboardInterrupt
    assert Journal.open(tmp_path).in_all() == (None, None)
    again = Journal.open(tmp_path)
    with again.stage("train"):
        pass
    with again.stage("report"):
        pass
    written = (tmp_path / STAGES).stat().st_mtime_ns
    third = Journal.open(tmp_path)
    with third.stage("train"):
        pass
    third.note("train", "two runs", "train: a network")
    assert (third.stages[0].name, third.stages[0].wall_s, third.stages[0].cpu_s) == ("train: a network", 90.0, 120.0)
    assert third.in_all() == (93.0, 124.0)
    assert third.so_far_s() == 93.0
    assert (tmp_path / STAGES).stat().st_mtime_ns == written


def test_nobody_knows_how_long_a_killed_stage_took(tmp_path: Path, clock: Clock) -> None:
    begun = Journal.open(tmp_path, new=True).stage("train")
    begun.__enter__()  # and no word of its end
    journal = Journal.open(tmp_path)
    for name in ("train", "report"):
        with journal.stage(name):
            pass
        journal.note(name, "something")
    assert [stage.wall_s for stage in journal.stages] == [None, 3.0]
    assert journal.in_all() == (None, None)


@pytest.mark.parametrize("record", [None, "{", "[]", '{"stages": {}}'])
def test_a_lost_record_knows_no_time(tmp_path: Path, clock: Clock, record: str | None) -> None:
    if record is not None:
        (tmp_path / STAGES).write_text(record)
    for _ in range(2):
        journal = Journal.open(tmp_path)
        with journal.stage("train"):
            pass
        assert journal.in_all() == (None, None)


def test_a_folder_is_claimed_once_and_by_one(tmp_path: Path) -> None:
    (tmp_path / ".DS_Store").touch()
    assert claim(tmp_path, {"a": 1}) is True
    assert claim(tmp_path, {"a": 1}) is False
    with pytest.raises(ConfigurationChanged, match="other settings"):
        claim(tmp_path, {"a": 2})


def experiment(seed: int = 0, epochs: int = 30, anatomy: str = "a" * 64, name: str = "reproduce") -> dict[str, object]:
    config = {
        "epochs": epochs,
        "runs": epochs,
        "compact_runs": epochs,
        "sizes": {"test_positions": epochs},
        "seed": seed,
    }
    return {"experiment": name, "anatomy": anatomy, "look": {"material": {"image": [seed]}}, "config": config}


@pytest.mark.parametrize(
    ("other", "told"),
    [
        (experiment(seed=1), r"other settings: --seed \(0 → 1\), --texture;"),
        (
            experiment(epochs=2),
            r"other settings: --epochs \(30 → 2\), --runs \(30 → 2\), sizes test positions \(30 → 2\);",
        ),
        (experiment(seed=1, epochs=2), r"--epochs \(30 → 2\), --runs \(30 → 2\), --seed \(0 → 1\) and 2 more;"),
        (experiment(anatomy="b" * 64), "got other data: the anatomy;"),
        (experiment(seed=1, anatomy="b" * 64), "--texture and other data: the anatomy;"),
        (experiment(name="demo"), "got another, reproduce;"),
    ],
)
def test_another_experiment_is_refused_by_what_differs(tmp_path: Path, other: dict[str, object], told: str) -> None:
    claim(tmp_path, experiment())
    with pytest.raises(ConfigurationChanged, match=told):
        claim(tmp_path, other)


def test_a_folder_of_somebody_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "report.html").write_text("mine")
    with pytest.raises(InputError, match="new or empty folder"):
        claim(tmp_path, {"a": 1})
    with pytest.raises(InputError, match="a file"):
        claim(tmp_path / "report.html", {"a": 1})
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]


def test_settings_of_another_program_are_not_ours(tmp_path: Path) -> None:
    (tmp_path / "settings.json").write_text(json.dumps({"theme": "dark"}))
    with pytest.raises(ConfigurationChanged):
        claim(tmp_path, {"a": 1})
