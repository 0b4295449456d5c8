"""A head made by code, its scan, what is found in it and in real ones: made once in a test run, as each takes long."""

from __future__ import annotations

import fcntl
import os
import pickle
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import TypeVar

from naris.airway.fitness import STEP_MM, Fitness, inspect_scan
from naris.airway.segment import Airway, segment_airway
from naris.anatomy.builtin import built_in_nose
from naris.anatomy.scanned import ScannedAnatomy, anatomy_of_airway
from naris.anatomy.virtual_ct import Scanner, virtual_ct
from naris.core.anatomy import Anatomy
from naris.core.volume import Volume
from naris.ct.read import read_scan

SHARED = "NARIS_TESTS_SHARED"
"""The variable with the folder that the processes of one test run share; unset where there is one process only."""

Made = TypeVar("Made")


@cache
def nose() -> Anatomy:
    return once("nose", built_in_nose)


@cache
def bare_nose() -> Anatomy:
    """The same nose without its passages."""
    return once("bare nose", lambda: built_in_nose(passages=False))


@cache
def scan() -> Volume:
    return once("scan", lambda: virtual_ct(nose(), Scanner()))


@cache
def airway() -> Airway:
    return once("airway", lambda: segment_airway(scan()))


@cache
def coarse_airway() -> Airway:
    """As a first look finds it."""
    return once("coarse airway", lambda: segment_airway(scan(), STEP_MM))


@cache
def found() -> ScannedAnatomy:
    return once("found", lambda: anatomy_of_airway(airway(), "made again", "a test"))


@cache
def looked_at(path: Path) -> Fitness:
    """What a first look at the scan in a file says."""
    return once(f"look at {path.name}", lambda: inspect_scan(read_scan(path)))


def once(name: str, make: Callable[[], Made]) -> Made:
    """Made by the first process that asks; the others wait for it, and read it."""
    if SHARED not in os.environ:
        return make()
    kept = Path(os.environ[SHARED]) / f"{name}.pickle"
    with kept.with_suffix(".lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not kept.exists():
            made = make()
            part = kept.with_suffix(".part")
            part.write_bytes(pickle.dumps(made))
            part.rename(kept)
            return made
    return pickle.loads(kept.read_bytes())
