"""Compiled loops spread over the cores; what they give does not depend on how many there are."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from itertools import pairwise

import numpy as np

from naris.core.cores import cores

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
    list(_pool(threads, os.getpid()).map(lambda part: work(*part), pairwise(edges)))


@lru_cache(maxsize=2)
def _pool(threads: int, process: int) -> ThreadPoolExecutor:
    """The threads of a process: a forked one inherits the pool without its threads, and needs its own."""
    return ThreadPoolExecutor(threads, thread_name_prefix="naris-register")
