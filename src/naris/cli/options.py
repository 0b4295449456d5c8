"""What the numbers of a command line may be, for the options of every verb, by their names.

They are looked at before a verb begins, so that a wrong one costs a sentence and touches no folder.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from naris.errors import InputError


@dataclass(frozen=True)
class Range:
    """Finite numbers from `least` to `most`.

    Attributes:
        least: the smallest that is allowed.
        most: the largest.
        above: `least` itself is not.
    """

    least: float = -math.inf
    most: float = math.inf
    above: bool = False

    def __contains__(self, number: float) -> bool:
        low = number > self.least if self.above else number >= self.least
        return math.isfinite(number) and low and number <= self.most

    def __str__(self) -> str:
        if self == Range():
            return "a finite number"
        low = f"above {self.least:g}" if self.above else f"of {self.least:g} or more"
        return f"a number {low}" if math.isinf(self.most) else f"a number {low}, at most {self.most:,}"


_COUNT, _SEED, _AT_A_TIME = Range(1), Range(0, 2**63 - 1), Range(1, 1024)
_LENGTH, _SILENCE = Range(0, above=True), Range(0, 24 * 3600, above=True)
_SHARE = Range(0, 1)

ALLOWED: Mapping[str, Range] = {
    "seed": _SEED,
    "seeds": _SEED,
    "workers": _AT_A_TIME,
    "threads": _AT_A_TIME,
    "count": _COUNT,
    "per_position": _COUNT,
    "width": _COUNT,
    "height": _COUNT,
    "runs": _COUNT,
    "epochs": _COUNT,
    "compact_epochs": _COUNT,
    "steps": _COUNT,
    "at_will_steps": _COUNT,
    "attempts": _COUNT,
    "step_mm": _LENGTH,
    "probability": _SHARE,
    "out_of_domain": _SHARE,
    "budget_s": _LENGTH,
    "timeout_s": _SILENCE,
}
"""By the name of the option, in any verb; any other number must only be finite."""


def check_numbers(options: Any) -> None:
    """See that every number among a verb's options is one that the verb can use.

    Args:
        options: the verb's frozen dataclass; numbers and tuples of numbers are looked at, everything else is not.

    Raises:
        InputError: if a number is not finite or out of its range; the message names the option.
    """
    for field in fields(options):
        value, allowed = getattr(options, field.name), ALLOWED.get(field.name, Range())
        for number in value if isinstance(value, tuple) else (value,):
            if isinstance(number, (int, float)) and number not in allowed:
                raise InputError(f"--{field.name.replace('_', '-')} {allowed}", f"{number}", "correct it")
