"""How something was made: version, digest of a configuration, machine, libraries, CPU time.

Nothing here tells who or where: no host, user or folder names.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import subprocess
import time
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from importlib import metadata
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np

import naris
from naris.core.cores import cores

LIBRARIES = (
    "numpy",
    "scipy",
    "numba",
    "embreex",
    "torch",
    "opencv-python-headless",
    "scikit-image",
    "trimesh",
    "vtk",
    "small-gicp",
    "open3d",
)
"""The distributions whose version can change a result."""

_LARGE = 64


def versions() -> dict[str, str]:
    """The version of naris, Python, and each of `LIBRARIES` that is installed."""
    found = {"naris": naris.__version__, "python": platform.python_version()}
    for name in LIBRARIES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


@cache
def machine() -> dict[str, str | int | float]:
    """Processor, cores that this process may use, memory in GiB and operating system."""
    return {
        "processor": _processor(),
        "cores": cores(),
        "memory_gib": round(os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30, 1),
        "system": f"{platform.system()} {platform.machine()}",
    }


@cache
def commit() -> str | None:
    """The commit of the checkout that the code runs from, `-dirty` behind it if tracked files differ; else None.

    As it was when it was asked for first: what runs on does not become what somebody commits meanwhile.
    """
    here = Path(naris.__file__).resolve().parent
    if _git(here, "ls-files", "--error-unmatch", "__init__.py") is None:
        return None
    head = _git(here, "rev-parse", "HEAD")
    changed = _git(here, "status", "--porcelain", "--untracked-files=no")
    return f"{head}-dirty" if head and changed else head


def plain(value: Any) -> Any:
    """A configuration as JSON can hold it: dataclasses by field, arrays as lists, paths and enums as text.

    Arrays of more than 64 numbers become their shape, type and SHA-256.

    Raises:
        TypeError: if a value is none of these.
    """
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return value.tolist() if value.size <= _LARGE else _array_digest(value)
    if isinstance(value, (set, frozenset)):
        return sorted(plain(item) for item in value)
    if isinstance(value, (list, tuple)):
        return [plain(item) for item in value]
    if isinstance(value, Enum):
        return value.name
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, (bool, int, float, str)):
        return value
    if isinstance(value, Path):
        return str(value)
    raise TypeError(f"a configuration cannot hold a {type(value).__name__}")


def digest(configuration: Any) -> str:
    """SHA-256 of a configuration: equal settings, equal digest, on any machine and in any version of Python.

    The names of the dataclasses count, and whole floats count as integers (`1.0` is `1`). See `plain` for errors.
    """
    canonical = json.dumps(_tagged(configuration), sort_keys=True, separators=(",", ":"), ensure_ascii=True)
    return hashlib.sha256(canonical.encode()).hexdigest()


def file_digest(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


class Stopwatch:
    """Wall and CPU seconds since entering, as a context manager; after leaving they stand still.

    CPU time is the operating system's, over all threads of this process and of its children that have ended.
    """

    def __enter__(self) -> Stopwatch:
        self._wall, self._cpu = time.perf_counter(), cpu_seconds()
        self._end: tuple[float, float] | None = None
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._end = (time.perf_counter(), cpu_seconds())

    @property
    def wall_s(self) -> float:
        return (self._end[0] if self._end else time.perf_counter()) - self._wall

    @property
    def cpu_s(self) -> float:
        return (self._end[1] if self._end else cpu_seconds()) - self._cpu


def cpu_seconds() -> float:
    """CPU time so far over all threads of this process and of its children that have ended."""
    children = os.times()
    return time.process_time() + children.children_user + children.children_system


def _tagged(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        body = {field.name: _tagged(getattr(value, field.name)) for field in fields(value)}
        return {"": type(value).__name__, **body}
    if isinstance(value, Mapping):
        return {str(key): _tagged(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_tagged(item) for item in value]
    settled = plain(value)
    if isinstance(settled, list):
        return [_tagged(item) for item in settled]
    if isinstance(settled, float):
        return int(settled) if settled.is_integer() else repr(settled)
    return settled


def _array_digest(array: np.ndarray) -> dict[str, Any]:
    content = np.ascontiguousarray(array, dtype=array.dtype.newbyteorder("<"))
    return {
        "shape": list(array.shape),
        "dtype": content.dtype.str,
        "sha256": hashlib.sha256(content.tobytes()).hexdigest(),
    }


def _processor() -> str:
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _git(folder: Path, *words: str) -> str | None:
    """What git says, or None where it is missing or refuses."""
    try:
        done = subprocess.run(["git", *words], cwd=folder, capture_output=True, text=True, timeout=10, check=False)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None
