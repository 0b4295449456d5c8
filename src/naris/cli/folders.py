"""Whose a folder is, before a verb spends work on what goes into it."""

from __future__ import annotations

from collections.abc import Collection
from pathlib import Path

from naris.errors import InputError


def check_own(folder: Path, own: Collection[str], what: str) -> None:
    """See that a folder is new, empty (hidden files do not count), or holds nothing but a verb's own files.

    Args:
        folder: where a verb will write.
        own: names of what it writes there.
        what: these are, for the message.

    Raises:
        InputError: if not; nothing is touched.
    """
    if folder.exists() and not folder.is_dir():
        raise InputError(f"a folder at {folder}", "a file", "give another path")
    if folder.exists() and any(not one.name.startswith(".") and one.name not in own for one in folder.iterdir()):
        raise InputError(f"a new or empty folder, or one with {what}", f"other files in {folder}", "give another path")
