"""Several trainings side by side: the same weights with any number of workers, and all stop when one is to stop."""

from __future__ import annotations

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import pytest

from naris.core.anatomy import SlabRegions
from naris.core.camera import Intrinsics
from naris.core.pose import Pose
from naris.dataset.layout import RegionLabels
from naris.errors import ConfigurationChanged, DiskFull
from naris.model.checkpoint import Subject
from naris.model.two_layer import TwoLayerConfig
from naris.train import PUBLISHED, Examples, train, train_runs
from naris.train.loop import RUN, STATE

REPOSITORY = Path(__file__).resolve().parents[2]
SLABS = SlabRegions("paper", ("a", "b", "c"), "mean", 1, (-10.0, 10.0))
SHORT = PUBLISHED.lasting(epochs=1).with_(network=TwoLayerConfig(24), batch=8)
ENDLESS = SHORT.lasting(epochs=1_000_000)
LONG_S = 30.0
"""Far longer than a step and its state take, far shorter than the training that is interrupted."""

CHILD = """
import sys
from pathlib import Path
from tests.train.test_runs import ENDLESS, examples, Told
from naris.train import train_runs
train_runs(examples(), ENDLESS, [0, 1, 2], Path(sys.argv[1]), workers=2, progress=Told())
"""


def examples(n: int = 24) -> Examples:
    rng = np.random.default_rng(0)
    place = rng.uniform([-5, -30, -5], [5, 30, 5], (n, 3))
    poses = Pose.of(np.tile(np.eye(3), (n, 1, 1)), place, "mean", "camera")
    subject = Subject(RegionLabels.of(SLABS), "noise", "0" * 64, "mean", Intrinsics.from_vertical_fov(24, 24, 45.0))
    images = rng.integers(0, 255, (n, 24, 24, 3), dtype=np.uint8)
    return Examples(images, SLABS.label(place), poses, subject, np.arange(n) // 8)


class Told:
    """Progress that prints the name of each task at its first step."""

    @contextmanager
    def task(self, name: str, total: int) -> Iterator[object]:
        told: list[str] = []

        def advance(steps: int) -> None:
            if not told and steps:
                told.append(name)
                print(name, flush=True)

        yield advance


@contextmanager
def two_runs(folder: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that trains endlessly in `folder`, two runs at a time, once both have begun; nothing of it is left."""
    child = subprocess.Popen(
        [sys.executable, "-c", CHILD, str(folder)],
        cwd=REPOSITORY,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    with child:
        try:
            assert child.stdout is not None
            assert {child.stdout.readline().strip() for _ in range(2)} == {"seed 0", "seed 1"}
            yield child
        finally:
            for left in in_session(child.pid):
                os.kill(left, signal.SIGKILL)


def in_session(leader: int) -> list[int]:
    """The processes of a session that still run."""
    found = []
    for stat in Path("/proc").glob("[0-9]*/stat"):
        with suppress(OSError):
            state, _, _, session = stat.read_text().rpartition(")")[2].split()[:4]
            if int(session) == leader and state != "Z":
                found.append(int(stat.parent.name))
    return found


@pytest.fixture
def threads_of(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The torch threads that each training in this process asks for."""
    asked: list[int] = []

    def noted(data: object, config: object, *rest: object, **named: object) -> object:
        asked.append(config.torch_threads)
        return train(data, config, *rest, **named)

    monkeypatch.setattr("naris.train.runs.train", noted)
    return asked


@pytest.mark.long
def test_the_number_of_workers_decides_no_weight(tmp_path: Path) -> None:
    runs = [train_runs(examples(), SHORT, [0, 1], tmp_path / str(n), workers=n) for n in (1, 3)]
    for settings in zip(*[[run.settings for run in some] for some in runs], strict=True):
        assert settings[0]["threads"] == 1
        assert settings[0] == settings[1]


@pytest.mark.parametrize("workers", [1, 2])
def test_a_single_run_has_the_threads_of_its_configuration(tmp_path: Path, threads_of: list[int], workers: int) -> None:
    train_runs(examples(), SHORT, [0], tmp_path / "one", workers=workers)
    train_runs(examples(), SHORT.with_(threads=3), [0], tmp_path / "three", workers=workers)
    assert threads_of == [SHORT.torch_threads, 3]


@pytest.mark.slow
@pytest.mark.parametrize("to", ["one process", pytest.param("all processes", marks=pytest.mark.long)])
def test_ctrl_c_stops_every_run_with_its_state_written(tmp_path: Path, to: str) -> None:
    """A program sends the signal to the process that it knows, a terminal to all that it started."""
    with two_runs(tmp_path) as child:
        begun = time.monotonic()
        (os.kill if to == "one process" else os.killpg)(child.pid, signal.SIGINT)
        _, errors = child.communicate(timeout=LONG_S)
        assert time.monotonic() - begun < LONG_S
    assert child.returncode != 0
    assert errors.count("Traceback") == 1, errors  # that of the child itself, which does not catch it
    assert errors.strip().endswith("KeyboardInterrupt")
    assert sorted(path.relative_to(tmp_path).as_posix() for path in tmp_path.rglob("*") if path.is_file()) == [
        f"seed-0/{STATE}",
        f"seed-1/{STATE}",
    ]


@pytest.mark.slow
def test_runs_end_with_a_parent_that_is_killed_and_leave_their_state(tmp_path: Path) -> None:
    with two_runs(tmp_path) as child:
        child.kill()
        child.wait()
        until = time.monotonic() + LONG_S
        while in_session(child.pid) and time.monotonic() < until:
            time.sleep(0.2)
        assert in_session(child.pid) == []
    assert sorted(path.parent.name for path in tmp_path.rglob(STATE)) == ["seed-0", "seed-1"]


@pytest.mark.long
def test_a_run_that_fails_stops_those_beside_it(tmp_path: Path) -> None:
    train(examples(), SHORT.with_(seed=1), tmp_path / "seed-1")
    begun = time.monotonic()
    with pytest.raises(ConfigurationChanged):
        train_runs(examples(), ENDLESS, [0, 1, 2], tmp_path, workers=2)
    assert time.monotonic() - begun < 60
    assert not (tmp_path / "seed-0" / RUN).exists()
    assert not (tmp_path / "seed-2" / RUN).exists()


def test_pictures_that_a_kill_left_are_removed(tmp_path: Path) -> None:
    (tmp_path / ".pictures-left").mkdir()
    (tmp_path / ".pictures-left" / "images.bin").write_bytes(b"0")
    train_runs(examples(), SHORT, [0], tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["seed-0"]


def test_no_room_for_the_pictures_is_told(tmp_path: Path) -> None:
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (8192, before[1]))
    try:
        with pytest.raises(DiskFull, match="room on the disk"):
            train_runs(examples(), SHORT, [0, 1], tmp_path, workers=2)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert list(tmp_path.iterdir()) == []
