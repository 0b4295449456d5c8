"""The same bytes for any number of workers, through kills, interrupts and full disks."""

from __future__ import annotations

import getpass
import json
import os
import signal
import subprocess
import sys
import textwrap
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from naris.core.camera import Intrinsics
from naris.dataset.generate import simulate
from naris.dataset.layout import depth_to_steps
from naris.dataset.read import Dataset
from naris.errors import ConfigurationChanged, DatasetError, DiskFull
from naris.render.appearance import PAPER
from naris.render.scene import Scene, render
from tests.dataset.small import hashes, small_simulation
from tests.winding_tube import SLABS, winding_tube

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def scene() -> Scene:
    return Scene(winding_tube())


@pytest.fixture(scope="module")
def made(scene, tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("made") / "set"
    simulate(small_simulation(), folder, scene=scene, workers=1)
    return folder


class Counter:
    """A progress that adds up."""

    def __init__(self) -> None:
        self.total = self.steps = 0

    @contextmanager
    def task(self, name, total):
        self.total = total

        def advance(steps):
            self.steps += steps

        yield advance


@pytest.mark.parametrize("workers", [2, 5])
def test_the_bytes_are_the_same_for_any_number_of_workers(made, scene, tmp_path, workers) -> None:
    simulate(small_simulation(), tmp_path / "set", scene=scene, workers=workers)
    expected = hashes(made)
    assert len(expected) == 2 + 2 * 24
    assert hashes(tmp_path / "set") == expected


def test_another_seed_gives_other_pictures_of_the_same_depth(made, scene, tmp_path) -> None:
    simulate(small_simulation(seed=8), tmp_path / "set", scene=scene)
    one, other = hashes(made), hashes(tmp_path / "set")
    assert all(one[f"images/{i:06d}.png"] != other[f"images/{i:06d}.png"] for i in range(24))
    assert all(one[f"depth/{i:06d}.png"] == other[f"depth/{i:06d}.png"] for i in range(24))


def test_pictures_depth_and_labels_are_what_the_renderer_gives(scene, tmp_path) -> None:
    simulation = replace(small_simulation(6), appearance=PAPER)
    data = simulate(simulation, tmp_path / "set", scene=scene)
    direct = render(scene, simulation.views.anatomy_T_camera, simulation.intrinsics, PAPER)
    assert np.array_equal(data.images(), direct.rgb)
    for i in range(6):
        sample = data[i]
        assert np.abs(sample.depth_mm - direct.depth_mm[i]).max() <= data.depth_scale_mm * 0.501
        assert np.array_equal(sample.anatomy_T_camera.matrix, simulation.views.anatomy_T_camera.matrix[i])
        assert sample.region == simulation.views.region[i]
    assert data.intrinsics == simulation.intrinsics
    assert np.array_equal(data.views.position, simulation.views.position)


def test_without_depth_there_is_none(scene, tmp_path) -> None:
    data = simulate(replace(small_simulation(3), depth=False), tmp_path / "set", scene=scene)
    assert data.depth_files is None
    assert data[0].depth_mm is None
    assert not (tmp_path / "set" / "depth").exists()


def test_a_depth_picture_keeps_near_walls_and_refuses_what_does_not_fit() -> None:
    assert depth_to_steps(np.array([0, 1e-4, 0.005, 10.0, 327.0], np.float32)).tolist() == [0, 1, 1, 2000, 65400]
    with pytest.raises(DatasetError, match="depths below 328 mm"):
        depth_to_steps(np.array([400.0], np.float32))


def test_a_second_run_does_nothing_and_a_damaged_file_is_made_again(made, scene, tmp_path) -> None:
    folder = tmp_path / "set"
    simulate(small_simulation(), folder, scene=scene)
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*")}
    counter = Counter()
    simulate(small_simulation(), folder, scene=scene, progress=counter)
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*")} == before
    assert (counter.total, counter.steps) == (24, 24)
    damaged = folder / "images" / "000004.png"
    damaged.write_bytes(damaged.read_bytes()[:-40])
    (folder / "depth" / "000009.png").unlink()
    (folder / SAMPLES_PART).write_text("left by a killed process")
    simulate(small_simulation(), folder, scene=scene)
    assert hashes(folder) == hashes(made)


SAMPLES_PART = ".samples.0011aabb.part.jsonl"


def test_another_configuration_is_refused_by_name_and_nothing_is_touched(made) -> None:
    before = hashes(made)
    changes = {
        "the seed": small_simulation(seed=9),
        "the choice of views": small_simulation(23),
        r"the appearance \(.*light.*\)": replace(small_simulation(), appearance=PAPER),
        r"the camera \(.*fx.*\)": replace(small_simulation(), intrinsics=Intrinsics.from_vertical_fov(40, 40, 50.0)),
        "the anatomy": replace(
            small_simulation(), anatomy=winding_tube().with_(vertices_mm=winding_tube().vertices_mm * 1.01)
        ),
        "whether depth is kept": replace(small_simulation(), depth=False),
        "the region set": replace(small_simulation(), regions=replace(SLABS, borders_mm=(-20.0, 0.0, 21.0))),
    }
    for name, simulation in changes.items():
        with pytest.raises(ConfigurationChanged, match=name):
            simulate(simulation, made)
    assert hashes(made) == before


def test_a_scene_of_another_anatomy_is_refused(scene, tmp_path) -> None:
    larger = winding_tube().with_(vertices_mm=winding_tube().vertices_mm * 1.01)
    with pytest.raises(DatasetError, match="a scene of"):
        simulate(replace(small_simulation(), anatomy=larger), tmp_path / "set", scene=scene)
    assert not list(tmp_path.iterdir())


def test_a_folder_of_something_else_is_refused(scene, tmp_path) -> None:
    (tmp_path / "thesis.txt").write_text("precious")
    with pytest.raises(DatasetError, match="other files"):
        simulate(small_simulation(), tmp_path, scene=scene)
    with pytest.raises(DatasetError, match="a file"):
        simulate(small_simulation(), tmp_path / "thesis.txt", scene=scene)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_the_record_says_how_and_neither_who_nor_where_nor_when(made) -> None:
    text = (made / "dataset.json").read_text()
    about = json.loads(text)
    assert about["schema"] == "naris.dataset/1"
    assert about["anatomy"]["digest"] == winding_tube().digest
    assert about["regions"]["names"] == ["one", "two", "three", "four"]
    assert about["views"]["kind"] == "a test"
    assert about["appearance"]["kind"] == "AppearanceDistribution"
    for word in (str(REPOSITORY), str(Path.home()), os.uname().nodename, f"/{getpass.getuser()}", time.strftime("%Y-")):
        assert word not in text
    rows = (made / "samples.jsonl").read_text()
    assert str(made.parent) not in rows


# --- processes that are killed, interrupted, and run out of room ---------------------------------------------------

_COUNT, _SIZE = 160, 120
_CODE = """
import sys
from pathlib import Path
from naris.dataset.generate import simulate
from naris.errors import DiskFull
from tests.dataset.small import small_simulation
{before}
try:
    simulate(small_simulation({count}, {size}), Path(sys.argv[1]), workers=2)
except DiskFull as error:
    print(error)
    sys.exit(2)
except KeyboardInterrupt:
    sys.exit(130)
"""


def start(folder: Path, before: str = "", count: int = _COUNT, size: int = _SIZE) -> subprocess.Popen[str]:
    code = textwrap.dedent(_CODE).format(before=before, count=count, size=size)
    return subprocess.Popen(
        [sys.executable, "-c", code, str(folder)],
        cwd=REPOSITORY, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def pictures(folder: Path) -> list[Path]:
    return list((folder / "images").glob("0*.png"))


def wait_for_pictures(process: subprocess.Popen[str], folder: Path, many: int) -> None:
    until = time.monotonic() + 300
    while len(pictures(folder)) < many:
        assert process.poll() is None, process.communicate()[1]
        assert time.monotonic() < until, "no pictures in time"
        time.sleep(0.01)


@pytest.fixture(scope="module")
def whole(scene, tmp_path_factory) -> dict[str, str]:
    folder = tmp_path_factory.mktemp("whole") / "set"
    simulate(small_simulation(_COUNT, _SIZE), folder, scene=scene, workers=2)
    return hashes(folder)


def test_a_killed_run_goes_on_to_the_same_bytes(whole, scene, tmp_path) -> None:
    folder = tmp_path / "set"
    process = start(folder)
    wait_for_pictures(process, folder, 30)
    process.send_signal(signal.SIGKILL)
    process.communicate()
    done = pictures(folder)
    assert len(done) < _COUNT
    with pytest.raises(DatasetError, match="finished"):
        Dataset.open(folder)
    kept = {path: path.stat().st_mtime_ns for path in done[:10]}
    simulate(small_simulation(_COUNT, _SIZE), folder, scene=scene, workers=3)
    assert hashes(folder) == whole
    assert {path: path.stat().st_mtime_ns for path in kept} == kept, "what was there is not made again"


def test_an_interrupt_leaves_only_whole_files(whole, tmp_path) -> None:
    folder = tmp_path / "set"
    process = start(folder)
    wait_for_pictures(process, folder, 16)
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=300)
    assert process.returncode == 130
    left = hashes(folder)
    assert 16 <= len(pictures(folder)) < _COUNT
    assert left.items() <= whole.items()


def test_a_full_disk_is_told_and_leaves_only_whole_files(whole, scene, tmp_path) -> None:
    """The size limit of a process is real, and fails in the middle of a file as a full disk does."""
    folder = tmp_path / "set"
    process = start(folder, "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (9000, 9000))")
    told, errors = process.communicate(timeout=300)
    assert process.returncode == 2, errors
    assert told.startswith("expected room on the disk to write")
    assert told.count("\n") == 1
    assert hashes(folder).items() <= whole.items()
    simulate(small_simulation(_COUNT, _SIZE), folder, scene=scene)
    assert hashes(folder) == whole


def test_a_disk_that_is_really_full(whole, tmp_path) -> None:
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=400k", "tmpfs", str(tmp_path)], capture_output=True, check=False
    )
    if mounted.returncode:
        pytest.skip("a file system of 400 kB cannot be mounted here")
    try:
        with pytest.raises(DiskFull, match="room on the disk"):
            simulate(small_simulation(_COUNT, _SIZE), tmp_path / "set", workers=2)
        left = hashes(tmp_path / "set")
        assert 2 < len(left) < len(whole)
        assert left.items() <= whole.items()
    finally:
        subprocess.run(["umount", str(tmp_path)], check=True)
