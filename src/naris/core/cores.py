"""How many cores there are to work on."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache


def cores() -> int:
    """Those that this process may use, at least 1; a machine may have more."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def pool(threads: int) -> ThreadPoolExecutor:
    """So many threads, kept for the next who asks; nothing that runs in it may wait for it."""
    return _pool(threads, os.getpid())


@lru_cache(maxsize=4)
def _pool(threads: int, process: int) -> ThreadPoolExecutor:
    """The threads of a process: a forked one inherits the pool without its threads, and needs its own."""
    return ThreadPoolExecutor(threads, thread_name_prefix="naris")
