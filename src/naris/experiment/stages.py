"""How long each stage of an experiment took, however often it was interrupted.

`stages.json` in the experiment's folder holds the seconds of every stage over all the calls that worked on it. A stage
that has ended is not counted again when a later call only reads what it made. Where a call was killed, or the record
was lost, nobody knows how long the stage took, and it is told so: no time is better than one that is too short.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path

from naris.core.atomic import write_json
from naris.core.provenance import Stopwatch
from naris.report.data import Stage

STAGES = "stages.json"
PICTURES, EVALUATE, REPORT = "pictures", "evaluate", "report"
_SCHEMA = "naris.stages/1"


@dataclass
class _Spent:
    """Seconds so far; `known` is False for good after a call that could not write what it took."""

    wall_s: float = 0.0
    cpu_s: float = 0.0
    known: bool = True
    running: bool = False
    ended: bool = False


class Journal:
    """The stages of the experiment in a folder, and what the report tells of them."""

    def __init__(self, path: Path, spent: dict[str, _Spent], whole: bool) -> None:
        self.stages: list[Stage] = []
        self._path, self._spent, self._whole = path, spent, whole

    @classmethod
    def open(cls, out: Path, *, new: bool = False) -> Journal:
        """The journal of the experiment in `out`; for a `new` one, an empty one is written.

        One that is missing or damaged knows no time of any stage.

        Raises:
            DiskFull: if there is no room.
        """
        path = out / STAGES
        if new:
            journal = cls(path, {}, whole=True)
            journal._write()
            return journal
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            spent = {str(name): _Spent(**one) for name, one in content["stages"].items()}
            return cls(path, spent, whole=content["schema"] == _SCHEMA and content["whole"] is True)
        except (OSError, ValueError, KeyError, TypeError, AttributeError):
            return cls(path, {}, whole=False)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Count what the block takes to the stage `name`, unless that has ended before; leaving normally ends it.

        Raises:
            DiskFull: if there is no room.
        """
        spent = self._spent.setdefault(name, _Spent())
        if spent.ended:
            yield
            return
        # Found running, it was killed in an earlier call, and took that with it.
        spent.known, spent.running = self._whole and spent.known and not spent.running, True
        self._write()
        try:
            with Stopwatch() as watch:
                yield
            spent.ended = True
        finally:
            spent.running = False
            spent.wall_s, spent.cpu_s = round(spent.wall_s + watch.wall_s, 3), round(spent.cpu_s + watch.cpu_s, 3)
            self._write()

    def note(self, name: str, made: str, title: str | None = None) -> None:
        """Tell of a stage in the report: what it made, as a phrase, and how it is called there."""
        wall_s, cpu_s = self._seconds(name)
        self.stages.append(Stage(title or name, made, wall_s, cpu_s))

    def in_all(self) -> tuple[float | None, float | None]:
        """Wall and CPU seconds of all stages together; None if one is not known or has not ended."""
        every = [self._seconds(name) for name in self._spent]
        if not every or any(wall is None or cpu is None for wall, cpu in every):
            return None, None
        return round(sum(wall or 0.0 for wall, _ in every), 3), round(sum(cpu or 0.0 for _, cpu in every), 3)

    def so_far_s(self) -> float:
        """Wall seconds that are on record, of all stages."""
        return sum(spent.wall_s for spent in self._spent.values())

    def _seconds(self, name: str) -> tuple[float | None, float | None]:
        spent = self._spent[name]
        return (spent.wall_s, spent.cpu_s) if spent.known and spent.ended else (None, None)

    def _write(self) -> None:
        stages = {name: asdict(spent) for name, spent in self._spent.items()}
        write_json(self._path, {"schema": _SCHEMA, "whole": self._whole, "stages": stages})
