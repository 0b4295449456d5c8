"""The choice of threads, with the clock in the test's hands."""

from __future__ import annotations

import pytest

from naris.model.compact import CompactConfig
from naris.train import pace

TINY = CompactConfig(input_px=16, channels=(8, 16), blocks=(1, 1), reduced=4, embedding=12, hypotheses=2)


@pytest.mark.parametrize(("alone_s", "together_s", "chosen"), [(1.0, 0.6, 2), (1.0, 0.95, 1), (1.0, 8.0, 1)])
def test_threads_are_taken_where_they_are_clearly_faster(
    monkeypatch: pytest.MonkeyPatch, alone_s: float, together_s: float, chosen: int
) -> None:
    monkeypatch.setattr(pace, "_mean_s", lambda network, images, threads: {1: alone_s, 2: together_s}[threads])
    assert pace.quicker_threads(TINY, 2, batch=4) == chosen


def test_one_is_one_and_a_real_measurement_gives_one_of_the_two() -> None:
    assert pace.quicker_threads(TINY, 1) == 1
    assert pace.quicker_threads(TINY, 2, batch=4) in (1, 2)
