"""What takes the time of a registration map, kept in a folder for other processes.

It is a cache: a file that cannot be read is made anew, one that cannot be written is done without, and of all of them
the last few that were used stay.
"""

from __future__ import annotations

import os
import time
import zipfile
import zlib
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, UInt8

from naris.core.atomic import PART, replacing
from naris.core.provenance import digest
from naris.errors import DiskFull

FORMAT = 1
"""To be raised with every change of what is computed: files of another one are not looked at."""

MOST_FILES = 16
_SUFFIX = ".map.npz"
_STALE_S = 3600.0


class MapArrays(NamedTuple):
    """See `naris.register.map.RegistrationMap`; the distances are those of its grid."""

    distances_mm: Float32[np.ndarray, "nx ny nz"]
    places_mm: Float[np.ndarray, "p 3"]
    panoramas: UInt8[np.ndarray, "p t"]


def map_file(folder: Path, anatomy: str, settings: Sequence[float]) -> Path:
    """Where the map of an anatomy, by its digest, lies that was made with these settings."""
    return folder / f"{digest([FORMAT, anatomy, list(settings)])[:32]}{_SUFFIX}"


def read_map(path: Path) -> MapArrays | None:
    """What was kept; None where there is no such file, or a broken one."""
    try:
        with path.open("rb") as file, np.load(file, allow_pickle=False) as kept:
            found = MapArrays(*(kept[name] for name in MapArrays._fields))
    except (OSError, ValueError, KeyError, EOFError, RuntimeError, zipfile.BadZipFile, zlib.error):
        return None  # RuntimeError: a damaged archive that looks encrypted, or of another version
    with suppress(OSError):  # a cache of somebody else may be read all the same
        os.utime(path)
    whole = len(found.places_mm) == len(found.panoramas) > 0 and found.distances_mm.ndim == 3
    return found if whole else None


def write_map(path: Path, arrays: MapArrays) -> None:
    """Keeps it if there is room and leave to; the files that were used longest ago make room."""
    with suppress(OSError, DiskFull):
        with replacing(path, durable=False) as part:
            np.savez(part, **arrays._asdict())
        for left in path.parent.glob(f".*{PART}.npz"):  # of a writer that was killed
            if time.time() - left.stat().st_mtime > _STALE_S:
                left.unlink(missing_ok=True)
        by_age = sorted(path.parent.glob(f"*{_SUFFIX}"), key=lambda file: file.stat().st_mtime, reverse=True)
        for old in by_age[MOST_FILES:]:
            old.unlink(missing_ok=True)
