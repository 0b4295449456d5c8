"""What a benchmark came to: figures with their goals and peers, and how they were measured, as one JSON object.

The file on disk is `{schema, command, commit, machine, versions, seed, seconds, inputs, figures}`; `figures` is a list
of `{name, value, unit, n, better, goal, interval, peers}`. `commit` is that of the working tree the code ran from, with
`-dirty` behind it where tracked files differed; null for an installed package.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

from naris.core.atomic import to_json
from naris.errors import InputError

SCHEMA = "naris.bench/1"

Better = Literal["higher", "lower"]
Peer = float | str
"""What a peer measured in the same run, or the sentence that says why it could not start."""


@dataclass(frozen=True)
class Figure:
    """One measured number.

    Attributes:
        name: dotted, as the issues and documents call it, e.g. `render.plain.300.cpu_ms`.
        value: in `unit`; None where nothing was measured: left out by `--quick`, or `n` is 0.
        unit: e.g. `ms`, `fps`, `mm`, `%`, or `1` for a share of one.
        n: how many trials, frames or pictures stand behind the value.
        better: which way is better.
        goal: the value that the project aims for, or None.
        interval: low and high end of a 95 % interval of `value`, or None.
        peers: by the name of the peer, its value in the same unit, or a text that says why it could not start.

    Raises:
        InputError: if a number is not finite, or `n` is negative.
    """

    name: str
    value: float | None
    unit: str
    n: int
    better: Better
    goal: float | None = None
    interval: tuple[float, float] | None = None
    peers: Mapping[str, Peer] = field(default_factory=dict)

    def __post_init__(self) -> None:
        numbers = [self.value, self.goal, *(self.interval or ()), *self.peers.values()]
        bad = [x for x in numbers if isinstance(x, float) and not math.isfinite(x)]
        if bad or self.n < 0:
            raise InputError(
                f"finite numbers and n ≥ 0 in the figure {self.name}",
                f"{bad[0] if bad else self.n}",
                "leave out what was not measured",
            )

    @property
    def reached(self) -> bool | None:
        """Whether the goal is met; None where there is no goal or no value."""
        if self.goal is None or self.value is None:
            return None
        return self.value >= self.goal if self.better == "higher" else self.value <= self.goal


@dataclass(frozen=True)
class Seconds:
    """How long something took: wall clock, and CPU over all threads (from the operating system).

    Both are None where nobody knows, as after a run that was killed and went on later.
    """

    wall: float | None
    cpu: float | None


@dataclass(frozen=True)
class BenchResult:
    """Figures and how they were measured.

    Attributes:
        command: as typed.
        commit: of the code, None if it is not known.
        machine: processor, cores, memory, system (`naris.core.provenance`).
        versions: of naris, Python and the packages that matter.
        seed: of everything random.
        seconds: of the whole benchmark.
        figures: in the order of measuring.
        inputs: what was measured on, by role, e.g. `anatomy`: name and digest.
    """

    command: str
    commit: str | None
    machine: Mapping[str, Any]
    versions: Mapping[str, str]
    seed: int
    seconds: Seconds
    figures: tuple[Figure, ...]
    inputs: Mapping[str, str] = field(default_factory=dict)
    schema: str = SCHEMA

    def figure(self, name: str) -> Figure:
        """The figure of that name.

        Raises:
            InputError: if there is none.
        """
        for figure in self.figures:
            if figure.name == name:
                return figure
        raise InputError(f"one of the figures {[f.name for f in self.figures]}", repr(name), "name one of those")

    def record(self) -> dict[str, Any]:
        """The object as JSON holds it; `schema` stands first."""
        fields = asdict(self)
        return {"schema": fields.pop("schema"), **fields}

    def to_json(self) -> str:
        """`record` as indented text."""
        return to_json(self.record())

    @staticmethod
    def from_json(text: str) -> BenchResult:
        """The inverse of `to_json`.

        Raises:
            InputError: if the text is not a benchmark result of this schema.
        """
        try:
            raw = json.loads(text)
            if raw["schema"] != SCHEMA:
                raise InputError(f"a benchmark result of schema {SCHEMA}", repr(raw["schema"]), "run it again")
            figures = tuple(
                Figure(**{**f, "interval": tuple(f["interval"]) if f["interval"] else None}) for f in raw["figures"]
            )
            return BenchResult(**{**raw, "seconds": Seconds(**raw["seconds"]), "figures": figures})
        except (json.JSONDecodeError, KeyError, TypeError, AttributeError) as error:
            raise InputError(
                "a benchmark result in JSON", f"{type(error).__name__}: {error}", "make it with `naris bench`"
            ) from error


def wilson(right: int, n: int) -> tuple[float, float]:
    """The 95 % interval of a share, of so many out of n > 0 (Wilson 1927)."""
    p, z = right / n, 1.96
    middle, half = p + z * z / (2 * n), z * math.sqrt(p * (1 - p) / n + z * z / (4 * n * n))
    low, high = (middle - half) / (1 + z * z / n), (middle + half) / (1 + z * z / n)
    return max(low, 0.0), min(high, 1.0)  # they are 0 and 1 at the ends but for rounding


def read_result(path: Path) -> BenchResult:
    """The benchmark result in a file.

    Raises:
        InputError: if the file cannot be read or is not one.
    """
    try:
        return BenchResult.from_json(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise InputError("a benchmark result in JSON", f"{path}: {error}", "make it with `naris bench`") from error
