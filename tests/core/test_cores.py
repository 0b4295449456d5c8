"""Cores are those that may be used, not those that are there."""

from __future__ import annotations

import os

import pytest

from naris.core.cores import cores


@pytest.mark.skipif(not hasattr(os, "sched_setaffinity"), reason="this system cannot bind a process to cores")
def test_counts_those_that_the_process_may_use() -> None:
    may = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {min(may)})
        assert cores() == 1
    finally:
        os.sched_setaffinity(0, may)
    assert cores() == len(may)
