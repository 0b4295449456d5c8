"""Compiled loops spread over the cores; what they give does not depend on how many there are."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np

from naris.core.cores import cores, pool

_PIECES = 4


def spread(work: Callable[[int, int], None], count: int, *, pieces: int | None = None) -> None:
    """Calls `work(first, last)` for parts of 0 … count − 1, side by side."""
    threads = cores()
    parts = min(pieces or _PIECES * threads, count)
    edges = np.linspace(0, count, parts + 1).astype(int).tolist()
    if threads == 1 or parts <= 1:
        for first, last in pairwise(edges):
            work(first, last)
        return
    list(pool(threads).map(lambda part: work(*part), pairwise(edges)))
