"""One writer at a time: two runs that write to one folder would mix what they keep."""

from __future__ import annotations

import hashlib
import logging
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from naris.errors import InputError

log = logging.getLogger(__name__)


@contextmanager
def held(out: Path) -> Iterator[None]:
    """Keep other runs of the same user from writing to `out` while the block runs.

    The lock is the operating system's (`flock` on a file in the folder for temporary ones), so that one that was killed
    leaves nothing that has to be cleaned up, and `out` itself need not be there. Where there is no `flock` (Windows),
    nothing is held. Held are equal paths, on one machine: a run that writes to a folder within is not seen.

    Args:
        out: a file or folder that a run writes.

    Raises:
        InputError: if another run holds it.
    """
    try:
        import fcntl
    except ImportError:
        yield
        return
    name = hashlib.sha256(os.fsencode(out.resolve())).hexdigest()[:16]
    lock = Path(tempfile.gettempdir()) / f"naris-{os.getuid()}-{name}.lock"
    descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o600)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise InputError(
                f"{out} to be written by one run at a time", "another that is writing there", "wait for it to end"
            ) from None
        except OSError as error:
            log.info("no lock can be held in %s: %s", lock.parent, error.strerror)
        yield
    finally:
        os.close(descriptor)
