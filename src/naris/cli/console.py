"""What a verb talks through: the answer on stdout, everything else on stderr."""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TextIO

from naris.core.atomic import to_json
from naris.core.progress import SILENT, Advance, Progress

LOG = logging.getLogger("naris")


@dataclass
class Console:
    """How a verb answers.

    Attributes:
        json: the answer is one JSON object.
        progress: where long work reports to: bars on a terminal, else nowhere.
        log: notices and warnings, on stderr.
        out: where the answer goes.
    """

    json: bool = False
    progress: Progress = SILENT
    log: logging.Logger = LOG
    out: TextIO = field(default_factory=lambda: sys.stdout)
    _answered: bool = False

    def answer(self, data: Mapping[str, Any], text: str) -> None:
        """Gives the result, once: `data` as JSON if that was asked for, else `text` for people.

        Raises:
            RuntimeError: if an answer has been given already (a fault of the verb).
            ValueError: if a number in `data` is not finite.
        """
        if self._answered:
            raise RuntimeError("a verb answers once")
        self._answered = True
        print(to_json(dict(data)) if self.json else text, file=self.out, flush=True)

    @property
    def answered(self) -> bool:
        """Whether the answer has been given."""
        return self._answered


class Bars:
    """Progress bars on a terminal; tasks that run inside or beside each other share one display."""

    def __init__(self) -> None:
        from rich.console import Console as Terminal
        from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeElapsedColumn, TimeRemainingColumn
        from rich.progress import Progress as Display

        columns = (
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("elapsed,"),
            TimeRemainingColumn(),
            TextColumn("to go"),
        )
        self._display = Display(*columns, console=Terminal(stderr=True), redirect_stdout=False)
        self._open = 0
        self._lock = threading.Lock()

    @contextmanager
    def task(self, name: str, total: int) -> Iterator[Advance]:
        """One bar; it stays where it came to when the work ends."""
        with self._lock:
            if not self._open:
                self._display.start()
            self._open += 1
        bar = self._display.add_task(name, total=total)
        try:
            yield lambda steps: self._display.advance(bar, steps)
        finally:
            with self._lock:
                self._open -= 1
                if not self._open:
                    self._display.stop()
                    for done in list(self._display.task_ids):
                        self._display.remove_task(done)


def console_for(flags: set[str]) -> Console:
    """The console that the options of every verb ask for, with logging set up on stderr."""
    quiet = "--quiet" in flags
    LOG.setLevel(logging.WARNING if quiet else logging.DEBUG if "--verbose" in flags else logging.INFO)
    LOG.propagate = False
    LOG.handlers = [_StderrLog()]
    bars = not quiet and sys.stderr is not None and sys.stderr.isatty()
    return Console(json="--json" in flags, progress=Bars() if bars else SILENT)


class _StderrLog(logging.Handler):
    """Writes to whatever stderr is now, so that lines come above a progress bar and not through it."""

    def emit(self, record: logging.LogRecord) -> None:
        mark = "" if record.levelno <= logging.INFO else f"{record.levelname.lower()}: "
        print(f"{mark}{record.getMessage()}", file=sys.stderr, flush=True)
