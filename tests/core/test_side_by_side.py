"""Jobs side by side: results in order, steps told under the names of the jobs' own tasks, an end for all."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial

import pytest

from naris.core.progress import SILENT, Progress
from naris.core.side_by_side import side_by_side
from naris.errors import InputError

ENDLESS_S = 120.0


class Noted:
    """Progress that keeps what it was told, and whether each task was open when it ended."""

    def __init__(self) -> None:
        self.steps: dict[str, list[int]] = {}
        self.ended: list[str] = []

    @contextmanager
    def task(self, name: str, total: int) -> Iterator[object]:
        self.steps[name] = [total]
        yield self.steps[name].append
        self.ended.append(name)


def counts(number: int, progress: Progress) -> int:
    for name in ("first", "second"):
        with progress.task(f"{name} of {number}", number) as advance:
            for _ in range(number):
                advance(1)
    return number


def goes_on(progress: Progress) -> None:
    """No training minds the end here, so that the telling of a step has to."""
    begun = time.monotonic()
    with progress.task("endless", 1_000_000) as advance:
        while time.monotonic() - begun < ENDLESS_S:
            time.sleep(0.01)
            advance(1)


def fails(progress: Progress) -> None:
    raise InputError("this", "that", "do something else")


def test_results_come_in_order_and_tasks_under_their_names() -> None:
    told = Noted()
    assert side_by_side([partial(counts, number) for number in (3, 1, 2)], 2, told) == [3, 1, 2]
    assert told.steps == {f"{name} of {n}": [n, *[1] * n] for n in (1, 2, 3) for name in ("first", "second")}
    assert sorted(told.ended) == sorted(told.steps)
    assert told.ended.index("first of 3") < told.ended.index("second of 3")


def test_a_job_that_fails_ends_those_beside_it() -> None:
    begun = time.monotonic()
    with pytest.raises(InputError, match="do something else"):
        side_by_side([goes_on, fails], 2, SILENT)
    assert time.monotonic() - begun < ENDLESS_S / 2
