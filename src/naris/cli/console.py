"""What a verb talks through: the answer on stdout, everything else on stderr."""

from __future__ import annotations

import logging
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any, TextIO

from naris.core.atomic import to_json
from naris.core.progress import SILENT, Advance, Progress

LOG = logging.getLogger("naris")
_LINE_EVERY_S = 15.0


@dataclass
class Console:
    """How a verb answers.

    Attributes:
        json: the answer is one JSON object.
        progress: where long work reports to: bars on a terminal, else a line now and then.
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


class Lines:
    """Progress as lines in a log, where no terminal can show bars: for each long task one every quarter of a minute."""

    def __init__(self, log: logging.Logger = LOG, clock: Callable[[], float] = time.monotonic) -> None:
        self._log, self._clock = log, clock

    @contextmanager
    def task(self, name: str, total: int) -> Iterator[Advance]:
        """Says nothing about a task that is over before the first line is due."""
        began_s = told_s = self._clock()
        done = 0
        lock = threading.Lock()

        def advance(steps: int) -> None:
            nonlocal done, told_s
            with lock:
                done += steps
                now_s = self._clock()
                if now_s - told_s >= _LINE_EVERY_S:
                    told_s = now_s
                    share = f"{100 * done // total} %, " if total else ""
                    self._log.info("%s: %s%.0f s", name, share, now_s - began_s)

        yield advance
        if told_s > began_s:
            self._log.info("%s: done in %.0f s", name, self._clock() - began_s)


def console_for(flags: set[str]) -> Console:
    """The console that the options of every verb ask for, with logging set up on stderr."""
    quiet = "--quiet" in flags
    LOG.setLevel(logging.WARNING if quiet else logging.DEBUG if "--verbose" in flags else logging.INFO)
    LOG.propagate = False
    LOG.handlers = [_StderrLog()]
    progress: Progress = SILENT
    if not quiet and sys.stderr is not None:
        progress = Bars() if sys.stderr.isatty() else Lines()
    return Console(json="--json" in flags, progress=progress)


class _StderrLog(logging.Handler):
    """Writes to whatever stderr is now, so that lines come above a progress bar and not through it."""

    def emit(self, record: logging.LogRecord) -> None:
        mark = "" if record.levelno <= logging.INFO else f"{record.levelname.lower()}: "
        print(f"{mark}{record.getMessage()}", file=sys.stderr, flush=True)
