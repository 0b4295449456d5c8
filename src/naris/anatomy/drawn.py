"""A virtual patient with what was drawn before it and passed over, and why."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from naris.core.anatomy import Anatomy

CROSSING = "walls that cross"
CLOSED = "a passage that closes"
UNFIT = "parts that do not fit together"


@dataclass(frozen=True, eq=False)
class Drawn:
    """What came of drawing a virtual patient.

    Attributes:
        anatomy: of the patient.
        passed_over: how many draws before it made no nose, by what they had (`CROSSING`, `CLOSED`, `UNFIT`).
    """

    anatomy: Anatomy
    passed_over: Mapping[str, int]


def told(passed_over: Mapping[str, int]) -> str:
    """`3 draws were passed over: 2 with walls that cross, 1 with a passage that closes`."""
    count = sum(passed_over.values())
    if not count:
        return "no draw was passed over"
    return f"{count} {'draw was' if count == 1 else 'draws were'} passed over: {reasons(passed_over)}"


def reasons(passed_over: Mapping[str, int]) -> str:
    """`2 with walls that cross, 1 with a passage that closes`."""
    return ", ".join(f"{count} with {why}" for why, count in passed_over.items() if count)
