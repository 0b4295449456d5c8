"""What long work says while it goes on, without a terminal."""

from __future__ import annotations

import logging

import pytest

from naris.cli.console import Lines


class Clock:
    """A clock that goes when it is told to."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


@pytest.fixture
def said(caplog: pytest.LogCaptureFixture) -> pytest.LogCaptureFixture:
    caplog.set_level(logging.INFO, logger="progress")
    return caplog


def test_a_long_task_says_now_and_then_how_far_it_is(said: pytest.LogCaptureFixture) -> None:
    clock = Clock()
    with Lines(logging.getLogger("progress"), clock).task("images", 60) as advance:
        for _ in range(60):
            clock.now_s += 1.0
            advance(1)
    assert said.messages == [
        "images: 25 %, 15 s",
        "images: 50 %, 30 s",
        "images: 75 %, 45 s",
        "images: 100 %, 60 s",
        "images: done in 60 s",
    ]


def test_a_short_task_says_nothing(said: pytest.LogCaptureFixture) -> None:
    clock = Clock()
    with Lines(logging.getLogger("progress"), clock).task("images", 2) as advance:
        clock.now_s += 10.0
        advance(2)
    assert said.messages == []


def test_a_task_that_is_broken_off_is_not_called_done(said: pytest.LogCaptureFixture) -> None:
    clock = Clock()
    with (
        pytest.raises(KeyboardInterrupt),
        Lines(logging.getLogger("progress"), clock).task("images", 2) as advance,
    ):
        clock.now_s += 20.0
        advance(1)
        raise KeyboardInterrupt
    assert said.messages == ["images: 50 %, 20 s"]
