"""Trials of a fit: each patient once, whoever did it, and nothing before all are there."""

from __future__ import annotations

from pathlib import Path

from naris.bench.fits import trials


def test_two_processes_share_the_patients_and_none_is_done_twice(tmp_path: Path) -> None:
    done: list[int] = []

    def made(number: int) -> list[list[object]]:
        done.append(number)
        return [["none b", float(number), True], ["none c", 0.5, False]]

    def kept(number: int) -> Path:
        return tmp_path / f"{number}.json"

    assert trials(0, 2, 3, kept, made) is None
    assert done == [0, 2]
    columns = trials(1, 2, 3, kept, made)
    assert columns is not None
    assert done == [0, 2, 1]
    of, kind, value, right = columns
    assert of.tolist() == [0, 0, 1, 1, 2, 2]
    assert kind.tolist() == ["none b", "none c"] * 3
    assert value.tolist() == [0.0, 0.5, 1.0, 0.5, 2.0, 0.5]
    assert right.tolist() == [True, False] * 3
