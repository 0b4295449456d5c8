"""How long work tells where it is: a protocol, and the one that says nothing."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Protocol, runtime_checkable

Advance = Callable[[int], None]
"""Called with the number of steps done since the last call."""


@runtime_checkable
class Progress(Protocol):
    """Where long work reports to. The command line draws bars; libraries and tests use `SILENT` or a fake."""

    def task(self, name: str, total: int) -> AbstractContextManager[Advance]:
        """Opens a piece of work of `total` steps; what comes out is called with each number of steps done.

        Tasks may nest. A task that is left early stays as far as it came.
        """
        ...


class Silent:
    """Progress that goes nowhere."""

    @contextmanager
    def task(self, name: str, total: int) -> Iterator[Advance]:
        yield lambda steps: None


SILENT: Progress = Silent()
