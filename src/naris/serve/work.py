"""A simulation that was begun from the page: how far it is, and that it should end."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass


class Stopped(Exception):
    """Somebody wants no more pictures."""


@dataclass
class Work:
    """A `naris.core.progress.Progress` that can be asked, and stopped: then what works is interrupted by `Stopped`."""

    done: int = 0
    total: int = 0
    running: bool = False
    said: str = ""
    folder: str = ""
    stopped: bool = False

    def task(self, name: str, total: int) -> Work:
        if self.stopped:
            raise Stopped
        self.done, self.total = 0, total
        return self

    def __enter__(self) -> Callable[[int], None]:
        return self._advance

    def __exit__(self, *error: object) -> None:
        return None

    def _advance(self, steps: int) -> None:
        if self.stopped:
            raise Stopped
        self.done += steps
