"""Files that are there whole or not at all.

What is written goes to a hidden file in the same folder first, is flushed to the disk and then takes its name in one
step (POSIX `rename`). A reader, or a run that takes up after a crash, never sees half a file.
"""

from __future__ import annotations

import errno
import json
import os
import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

from naris.errors import DiskFull, InputError

PART = ".part"
"""Stands in the name of a file that is not finished; such a file may be deleted when nobody writes."""

_NO_ROOM = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


@contextmanager
def replacing(path: Path, *, durable: bool = True) -> Iterator[Path]:
    """Gives a path to write to, in the folder and with the suffix of `path`; on leaving it takes the place of `path`.

    The folder is made if it is not there. When the block raises, what was written is removed and the old file stays.

    Args:
        path: the file to make or replace.
        durable: wait until the disk has it. Without, a power cut (not a crash of the program) may lose the file.

    Raises:
        DiskFull: if there is no room.
    """
    part = _part_of(path)
    try:
        with disk_full_told(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            yield part
            if durable:
                _flush(part, os.O_RDONLY)
            part.replace(path)
            if durable:
                _flush(path.parent, os.O_RDONLY | getattr(os, "O_DIRECTORY", 0))
    except OSError as error:
        if error.filename == str(part):  # a name that nobody typed and that is gone by now
            error.filename = str(path)
        raise
    finally:
        with suppress(NotADirectoryError):
            part.unlink(missing_ok=True)


def _part_of(path: Path) -> Path:
    """What stands in for a file until it is finished."""
    return path.with_name(f".{path.stem}.{secrets.token_hex(4)}{PART}{path.suffix}")


def check_writable(path: Path) -> None:
    """See that a file can be made or replaced there, before work is spent on what goes into it.

    Its folder is made if it is not there.

    Raises:
        InputError: if it is a folder or a device, or its folder is a file, or cannot be made or written to.
        DiskFull: if there is no room.
    """
    todo = "give another path"
    probe = _part_of(path)
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"a file to write at {path}", "a folder" if path.is_dir() else "no plain file", todo)
        with disk_full_told(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            probe.touch()
    except OSError as error:
        got = f"{os.strerror(error.errno).lower()}" if error.errno else "none"
        raise InputError(f"a place to write {path}", got, todo) from error
    finally:
        with suppress(OSError):
            probe.unlink(missing_ok=True)


def check_reachable(out: Path) -> None:
    """See that something can be made at `out`, before work is spent on it; nothing is made.

    A folder that holds something is the verb's to judge: it may have nothing to do there.

    Raises:
        InputError: if what is there, or the nearest folder above it, is not a folder or cannot be written to.
    """
    if out.is_dir() and any(out.iterdir()):
        return
    nearest = out if out.exists() else next(one for one in out.absolute().parents if one.exists())
    if nearest == out and not nearest.is_dir():
        nearest = nearest.absolute().parent
    if not nearest.is_dir():
        raise InputError(f"a place to write {out}", f"{nearest}, which is no folder", "give another path")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(f"a place to write {out}", f"{nearest}, where nothing may be written", "give another path")


def write_bytes(path: Path, content: bytes, *, durable: bool = True) -> None:
    """Makes or replaces a file.

    Raises:
        DiskFull: if there is no room; the old file, if any, stays.
    """
    with replacing(path, durable=durable) as part:
        part.write_bytes(content)


def write_text(path: Path, content: str, *, durable: bool = True) -> None:
    """Makes or replaces a file in UTF-8 (errors as `write_bytes`)."""
    write_bytes(path, content.encode(), durable=durable)


def write_json(path: Path, value: Any, *, durable: bool = True) -> None:
    """Makes or replaces an indented JSON file; numpy scalars and arrays become numbers and lists.

    Raises:
        DiskFull: if there is no room; the old file, if any, stays.
        ValueError: if a number is not finite (JSON has no word for it).
    """
    write_text(path, to_json(value) + "\n", durable=durable)


def to_json(value: Any, *, indent: int | None = 2) -> str:
    """JSON text; numpy scalars and arrays become numbers and lists, paths become text.

    Raises:
        ValueError: if a number is not finite.
        TypeError: if a value has no form in JSON.
    """
    return json.dumps(value, indent=indent, ensure_ascii=False, allow_nan=False, default=_plain_leaf)


@contextmanager
def disk_full_told(path: Path) -> Iterator[None]:
    """Turns the operating system's words for a full disk, inside the block, into `DiskFull`."""
    try:
        yield
    except OSError as error:
        if error.errno not in _NO_ROOM:
            raise
        raise DiskFull(
            f"room on the disk to write {path}",
            os.strerror(error.errno),
            "free some space and run the same command again: what is whole is kept",
        ) from error


def _flush(path: Path, flags: int) -> None:
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _plain_leaf(value: Any) -> Any:
    if isinstance(value, (np.ndarray, np.generic)):
        return value.tolist()
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"{type(value).__name__} has no form in JSON")
