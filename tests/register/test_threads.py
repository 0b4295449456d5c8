"""Work that is spread over threads: all of it, and nothing once it has ended."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest

from naris.register import threads
from naris.register.threads import spread


@pytest.mark.parametrize("cores", [1, 2, 3])
def test_all_is_done_once(cores: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "cores", lambda: cores)
    done = np.zeros(50, int)

    def work(first: int, last: int) -> None:
        done[first:last] += 1

    spread(work, 50)
    assert (done == 1).all()


def test_nothing_runs_any_more_after_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """As after Ctrl-C: a thread that reads what is freed next would crash the process."""
    monkeypatch.setattr(threads, "cores", lambda: 2)
    running, lock = [0], threading.Lock()

    def work(first: int, _last: int) -> None:
        if first == 0:
            raise KeyboardInterrupt
        with lock:
            running[0] += 1
        time.sleep(0.1)
        with lock:
            running[0] -= 1

    with pytest.raises(KeyboardInterrupt):
        spread(work, 64, pieces=16)
    assert running == [0]
