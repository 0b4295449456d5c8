"""What holds for the options of every verb: those that may be left out, what their numbers may be, where they apply.

Numbers are looked at before a verb begins, so that a wrong one costs a sentence and touches no folder.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Annotated, Any, TypeVar

import tyro

from naris.errors import InputError

T = TypeVar("T")
IfGiven = Annotated[T | None, tyro.conf.DisallowNone, tyro.conf.arg(help_behavior_hint="(optional)")]
"""An option that is None where it is not given; its help says in words what happens then, and never `None`."""


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
_LONGEST_NAME = 80
_EDGE = Range(1, 8192)  # twice the widest endoscopic video

ALLOWED: Mapping[str, Range] = {
    "seed": _SEED,
    "seeds": _SEED,
    "workers": _AT_A_TIME,
    "threads": _AT_A_TIME,
    "count": _COUNT,
    "virtual": Range(1, 100),
    "modes": _COUNT,
    "per_position": _COUNT,
    "width": _EDGE,
    "height": _EDGE,
    "patients": _COUNT,
    "runs": _COUNT,
    "epochs": _COUNT,
    "compact_epochs": _COUNT,
    "steps": _COUNT,
    "fit_steps": _COUNT,
    "at_will_steps": _COUNT,
    "attempts": _COUNT,
    "step_mm": _LENGTH,
    "spacing_mm": _LENGTH,
    "thickness_mm": _LENGTH,
    "amplitude_mm": Range(0, 5),  # at 4 hardly any draw leaves the passages of a nose open
    "noise_hu": Range(0),
    "blur_mm": Range(0),
    "metal": Range(0, 64),
    "probability": _SHARE,
    "depth_unit_mm": _LENGTH,
    "scale_factor": _LENGTH,
    "scale_spread": _LENGTH,
    "smooth_error": _SHARE,
    "noise": _LENGTH,
    "normals_deg": Range(0, 180, above=True),
    "most_tilt_deg": Range(0, 180, above=True),
    "most_roll_deg": Range(0, 180),
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
                raise InputError(f"{flag(field.name)} {allowed}", f"{number}", "correct it")


def check_edges(width: int, height: int) -> None:
    """See that pictures of a camera from a file are of a size that `--width` and `--height` may have.

    Raises:
        InputError: if not.
    """
    if not (width in _EDGE and height in _EDGE):
        raise InputError(
            f"pictures with edges of {_EDGE.least:g} to {_EDGE.most:,g} pixels", f"{width}×{height}", "correct it"
        )


def check_name(name: str) -> None:
    """See that what `--name` gives can stand in a line of every output.

    Raises:
        InputError: if it is empty, long, or holds what is not printed.
    """
    if not (name.strip() and name.isprintable() and len(name) <= _LONGEST_NAME):
        raise InputError(
            f"--name of 1 to {_LONGEST_NAME} printed letters", repr(name[: _LONGEST_NAME + 1]), "use another"
        )


def flag(name: str) -> str:
    """An option as it is typed."""
    return f"--{name.replace('_', '-')}"


def refuse(options: Any, names: Sequence[str], unless: str, got: str) -> None:
    """See that none of some options was given: one without effect must not be passed over in silence.

    Args:
        options: the verb's frozen dataclass, where an option that is not given is None.
        names: of the options that have no effect here.
        unless: where they have one, such as `only with an anatomy`.
        got: what there is instead.

    Raises:
        InputError: if one was given; the message names it.
    """
    given = [flag(name) for name in names if getattr(options, name) is not None]
    if given:
        raise InputError(f"{', '.join(given)} {unless}", got, f"leave {'it' if len(given) == 1 else 'them'} out")
