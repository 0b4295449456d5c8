"""Compiled loops spread over the cores; what they give does not depend on how many there are."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import wait
from itertools import pairwise

import numpy as np

from naris.core.cores import cores, pool

_PIECES = 4


def spread(work: Callable[[int, int], None], count: int, *, pieces: int | None = None) -> None:
    """Calls `work(first, last)` for parts of 0 … count − 1, side by side; none runs any more once it ends, however."""
    threads = cores()
    parts = min(pieces or _PIECES * threads, count)
    edges = np.linspace(0, count, parts + 1).astype(int).tolist()
    if threads == 1 or parts <= 1:
        for first, last in pairwise(edges):
            work(first, last)
        return
    running = [pool(threads).submit(work, first, last) for first, last in pairwise(edges)]
    try:
        for part in running:
            part.result()
    finally:
        # Interrupted, too: what they read of is freed when the process ends, and a thread that still reads crashes it.
        for part in running:
            part.cancel()
        wait(running)
