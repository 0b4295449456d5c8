"""How something was made: equal settings have equal digests, and nothing tells who or where."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from dataclasses import dataclass, field, replace
from enum import Enum
from pathlib import Path

import numpy as np
import pytest

import naris
from naris.core import provenance
from naris.core.camera import Brown, Intrinsics
from naris.core.progress import SILENT, Progress


class Colour(Enum):
    RED = 1


@dataclass(frozen=True)
class Inner:
    step_mm: float = 1.0


@dataclass(frozen=True)
class Other:
    step_mm: float = 1.0


@dataclass(frozen=True)
class Config:
    seed: int = 3
    inner: Inner | Other = Inner()
    intrinsics: Intrinsics = Intrinsics.from_vertical_fov(300, 300, 45, Brown(k1=0.1))
    names: tuple[str, ...] = ("a", "b")
    path: Path = Path("out")
    colour: Colour = Colour.RED
    table: np.ndarray = field(default_factory=lambda: np.arange(6.0).reshape(2, 3))
    maybe: float | None = None
    extra: dict[str, float] = field(default_factory=lambda: {"b": 2.5, "a": 1.5})


def test_equal_settings_equal_digest() -> None:
    again = replace(Config(), extra={"a": 1.5, "b": 2.5}, inner=Inner(1), table=np.arange(6.0).reshape(2, 3))
    assert provenance.digest(again) == provenance.digest(Config())


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 4},
        {"inner": Inner(1.0000001)},
        {"inner": Other()},
        {"names": ("a", "b", "")},
        {"maybe": 0.0},
        {"table": np.arange(6.0).reshape(3, 2)},
        {"table": np.arange(600.0)},
        {"extra": {}},
    ],
    ids=str,
)
def test_any_change_changes_the_digest(change: dict) -> None:
    assert provenance.digest(replace(Config(), **change)) != provenance.digest(Config())


def test_a_large_array_counts_by_its_content() -> None:
    large = np.zeros(1000)
    touched = large.copy()
    touched[777] = 1e-12
    assert provenance.digest({"a": large}) == provenance.digest({"a": np.zeros(1000)})
    assert provenance.digest({"a": large}) != provenance.digest({"a": touched})


def test_the_digest_is_the_same_in_another_process() -> None:
    program = "from naris.core.camera import *; from naris.core.provenance import digest; print(digest(Pinhole()))"
    environment = {**os.environ, "PYTHONHASHSEED": "12345"}
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment, check=True)
    from naris.core.camera import Pinhole

    assert done.stdout.strip() == provenance.digest(Pinhole())


def test_plain_is_json() -> None:
    told = json.loads(json.dumps(provenance.plain(Config())))
    assert told["inner"] == {"step_mm": 1.0}
    assert told["intrinsics"]["lens"]["kind"] == "brown"
    assert told["colour"] == "RED"
    assert told["path"] == "out"
    assert told["table"] == [[0, 1, 2], [3, 4, 5]]


def test_what_cannot_be_told_is_refused() -> None:
    with pytest.raises(TypeError, match="cannot hold"):
        provenance.digest({"a": object()})


def test_the_machine_is_described_without_names() -> None:
    machine, versions = provenance.machine(), provenance.versions()
    assert machine["cores"] >= 1
    assert machine["memory_gib"] > 0.1
    assert machine["processor"]
    assert versions["naris"] == naris.__version__
    assert versions["numpy"] == np.__version__
    assert set(machine) == {"processor", "cores", "memory_gib", "system"}
    assert str(Path.home()) not in json.dumps([machine, versions])


def test_the_commit_is_that_of_the_checkout() -> None:
    commit = provenance.commit()
    here = Path(naris.__file__).parent
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=here, capture_output=True, text=True, check=False)
    if head.returncode:
        assert commit is None
    else:
        assert commit.removesuffix("-dirty") == head.stdout.strip()


def test_cpu_time_counts_all_threads_and_children() -> None:
    def work() -> None:
        stop = time.thread_time() + 0.15
        while time.thread_time() < stop:
            np.linalg.svd(np.ones((60, 60)))

    with provenance.Stopwatch() as watch:
        threads = [threading.Thread(target=work) for _ in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        subprocess.run([sys.executable, "-c", "sum(range(4_000_000))"], check=True)
        time.sleep(0.1)
    assert watch.cpu_s > 0.3
    assert watch.wall_s > 0.1
    stands = watch.cpu_s, watch.wall_s
    work()
    assert (watch.cpu_s, watch.wall_s) == stands


def test_silent_progress_is_progress() -> None:
    assert isinstance(SILENT, Progress)
    with SILENT.task("outer", 2) as outer, SILENT.task("inner", 3) as inner:
        outer(1)
        inner(3)
