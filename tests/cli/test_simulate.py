"""`naris simulate`: what it writes, that it goes on where it stopped, and its one sentence for each refusal."""

from __future__ import annotations

import hashlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from naris.cli import main
from naris.core.pose import Pose
from naris.dataset.layout import intrinsics_to_json
from naris.dataset.original import read_original
from naris.dataset.read import Dataset
from naris.render.keyframes import Keyframes, write_keyframes, write_original_keyframes
from tests.winding_tube import SLABS, winding_tube

SMALL = ["--width", "24", "--height", "16", "--quiet"]


def simulate(tube: Path, out: Path, *words: str) -> int:
    return main(["simulate", str(tube), "-o", str(out), *SMALL, *words])


def content(folder: Path) -> dict[str, str]:
    files = (path for path in folder.rglob("*") if path.is_file())
    return {str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def keyframes() -> Keyframes:
    line = winding_tube().passages[0].points_mm[[20, 30, 44]]
    forward = np.diff(line, axis=0)
    return Keyframes.of(Pose.look(line, forward[[0, 1, 1]], np.array([0.0, 0, 1]), "LPS"))


def test_a_data_set_with_every_region_equally_often(tube: Path, tmp_path, capfd) -> None:
    assert simulate(tube, tmp_path / "out", "--count", "8", "--json") == 0
    told = json.loads(capfd.readouterr().out)
    assert told["count"] == 8
    assert told["regions"] == {"one": 2, "two": 2, "three": 2, "four": 2}
    dataset = Dataset.open(tmp_path / "out")
    assert dataset.images().shape == (8, 16, 24, 3)
    assert dataset.images().std() > 5
    assert dataset[3].depth_mm.max() > 1
    np.testing.assert_array_equal(SLABS.label(dataset.anatomy_T_camera.position_mm), dataset.labels)


def test_through_a_camera_of_any_lens_in_a_hand_that_shakes(tube: Path, tmp_path, capfd) -> None:
    """The data set's camera is that of the file; views of one position differ as a steady hand has them."""
    lens = {"kind": "fisheye", "k1": -0.02, "k2": 0.0, "k3": 0.0, "k4": 0.0}
    camera = {"width": 40, "height": 30, "fx": 20.0, "fy": 20.0, "cx": 19.0, "cy": 15.5, "lens": lens}
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    words = ["simulate", str(tube), "--intrinsics", str(tmp_path / "camera.json"), "--quiet", "--views", "trajectories"]
    spread = []
    for jitter in ("original", "steady"):
        out = tmp_path / jitter
        assert main([*words, "-o", str(out), "--count", "40", "--jitter", jitter]) == 0
        dataset = Dataset.open(out)
        assert intrinsics_to_json(dataset.intrinsics) == camera
        of_one = dataset.anatomy_T_camera.forward[dataset.views.position == 0]
        assert len(of_one) == 10
        spread.append(np.rad2deg(np.arccos(np.clip(of_one @ of_one.mean(axis=0), -1, 1))).mean())
    assert 2 * spread[0] < spread[1]
    (tmp_path / "camera.json").write_text('{"width": 64}')
    assert main([*words, "-o", str(tmp_path / "none")]) == 2
    assert capfd.readouterr().err.count("\n") == 1


def test_the_same_command_again_changes_nothing_and_workers_neither(tube: Path, tmp_path) -> None:
    assert simulate(tube, tmp_path / "a", "--count", "12", "--appearance", "training", "--workers", "1") == 0
    first = content(tmp_path / "a")
    stamps = {path: path.stat().st_mtime_ns for path in (tmp_path / "a").rglob("*.png")}
    assert simulate(tube, tmp_path / "a", "--count", "12", "--appearance", "training", "--workers", "1") == 0
    assert {path: path.stat().st_mtime_ns for path in stamps} == stamps
    assert simulate(tube, tmp_path / "b", "--count", "12", "--appearance", "training", "--workers", "3") == 0
    assert first == content(tmp_path / "a") == content(tmp_path / "b")


@pytest.mark.parametrize(
    "how",
    [pytest.param(signal.SIGINT, id="interrupted", marks=pytest.mark.slow), pytest.param(signal.SIGKILL, id="killed")],
)
def test_a_stopped_run_goes_on_to_the_same_bytes(tube: Path, tmp_path, how: signal.Signals) -> None:
    words = ["--count", "150", "--width", "200", "--height", "200", "--quiet", "--workers", "1"]
    command = [sys.executable, "-m", "naris", "simulate", str(tube), "-o", str(tmp_path / "a"), *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as running:
        patience = time.monotonic() + 90
        # What is being written has another name.
        while len(list((tmp_path / "a").glob("images/[0-9]*.png"))) < 5:
            assert running.poll() is None, running.stderr.read()
            assert time.monotonic() < patience
            time.sleep(0.01)
        running.send_signal(how)
        _, err = running.communicate(timeout=60)
    assert not (tmp_path / "a" / "samples.jsonl").exists()
    if how == signal.SIGINT:
        assert running.returncode == 130
        assert re.fullmatch(r"naris: interrupted: .*the same command goes on from there\n", err)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "a" / "images").glob("[0-9]*.png")}
    assert 5 <= len(before) < 150
    assert main(command[3:]) == 0
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert main([*command[3:5], "-o", str(tmp_path / "b"), *words[:-1], "2"]) == 0
    assert content(tmp_path / "a") == content(tmp_path / "b")


def test_from_keyframes_in_either_format(tube: Path, tmp_path) -> None:
    write_keyframes(keyframes(), tmp_path / "keyframes.json")
    write_original_keyframes(keyframes(), tmp_path / "pose")
    for name in ("keyframes.json", "pose"):
        words = ["--keyframes", str(tmp_path / name), "--per-position", "3"]
        assert simulate(tube, tmp_path / f"of {name}", *words) == 0
    one, other = (Dataset.open(tmp_path / f"of {name}") for name in ("keyframes.json", "pose"))
    steps = np.floor(np.linalg.norm(np.diff(keyframes().anatomy_T_camera.position_mm, axis=0), axis=1)) + 1
    assert len(one) == len(other) == 3 * steps.sum()
    np.testing.assert_allclose(one.anatomy_T_camera.matrix, other.anatomy_T_camera.matrix, atol=1e-5)


def test_the_folders_of_the_original_hold_the_same(tube: Path, tmp_path) -> None:
    assert simulate(tube, tmp_path / "ours", "--count", "5", "--original", str(tmp_path / "theirs")) == 0
    ours = Dataset.open(tmp_path / "ours")
    theirs = read_original(tmp_path / "theirs", SLABS, ours.intrinsics)
    np.testing.assert_array_equal(ours.images(), theirs.images())
    np.testing.assert_array_equal(ours.labels, theirs.labels)
    np.testing.assert_allclose(ours.anatomy_T_camera.position_mm, theirs.anatomy_T_camera.position_mm, atol=1e-5)


def test_the_folders_of_the_original_are_completed_and_then_left_alone(tube: Path, tmp_path) -> None:
    words = ["--count", "5", "--original", str(tmp_path / "theirs")]
    assert simulate(tube, tmp_path / "ours", *words) == 0
    whole = content(tmp_path)
    for lost in ("frame/03.png", "frame/04.png", "pose/03.txt", "pose/04.txt"):
        (tmp_path / "theirs" / lost).unlink()
    stamps = {path: path.stat().st_mtime_ns for path in (tmp_path / "theirs").rglob("0*")}
    for _ in range(2):
        assert simulate(tube, tmp_path / "ours", *words) == 0
        assert content(tmp_path) == whole
    assert {path: path.stat().st_mtime_ns for path in stamps} == stamps


@pytest.mark.parametrize("other", [["--seed", "1"], ["--appearance", "paper"], ["--count", "4"]], ids=str)
def test_folders_of_another_data_set_are_refused_before_anything_is_simulated(
    tube: Path, tmp_path, capfd, other: list[str]
) -> None:
    words = ["--count", "5", "--original", str(tmp_path / "theirs")]
    assert simulate(tube, tmp_path / "ours", *words) == 0
    before = content(tmp_path)
    capfd.readouterr()
    assert simulate(tube, tmp_path / "others", *words, *other) == 2
    assert re.fullmatch(r"naris: [^\n]+; give another folder[^\n]+\n", capfd.readouterr().err)
    assert content(tmp_path) == before


def test_trajectories_and_texture(tube: Path, tmp_path) -> None:
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (8, 8, 3), dtype=np.uint8)).save(tmp_path / "walls.png")
    words = ["--views", "trajectories", "--count", "25", "--per-position", "5", "--no-depth"]
    words += ["--appearance", "paper", "--texture", str(tmp_path / "walls.png")]
    assert simulate(tube, tmp_path / "out", *words) == 0
    dataset = Dataset.open(tmp_path / "out")
    np.testing.assert_array_equal(dataset.views.position, np.repeat(np.arange(5), 5))
    assert dataset.depth_files is None


def refused(kind: str, tube: Path, folder: Path) -> list[str]:
    if kind == "outside the lumen":
        poses = keyframes().anatomy_T_camera
        away = Pose.of(poses.rotation, poses.position_mm + [0.0, 0.0, 30.0], "LPS", "camera")
        write_keyframes(Keyframes.of(away), folder / "keyframes.json")
        return ["--keyframes", str(folder / "keyframes.json")]
    if kind == "no keyframes":
        (folder / "empty").mkdir()
        return ["--keyframes", str(folder / "empty")]
    if kind == "keyframes missing":
        return ["--keyframes", str(folder / "none.json")]
    if kind == "NaN pose":
        write_original_keyframes(keyframes(), folder / "pose")
        (folder / "pose" / "01.txt").write_text("1.0 nan\n0.0 1.0\n0.0 0.0\n")
        return ["--keyframes", str(folder / "pose")]
    if kind == "texture of text":
        (folder / "walls.png").write_text("not a picture")
        return ["--appearance", "paper", "--texture", str(folder / "walls.png")]
    if kind == "other seed":
        simulate(tube, folder / "out", "--count", "4")
        return ["--count", "4", "--seed", "1"]
    if kind == "folder of something else":
        (folder / "out").mkdir()
        (folder / "out" / "thesis.txt").write_text("precious")
        return []
    return {
        "texture with many looks": ["--appearance", "training", "--texture", "x.png"],
        "unknown regions": ["--regions", "lobes"],
        "nothing": ["--count", "0"],
        "no field of view": ["--fov-deg", "190"],
        "a picture larger than any": ["--width", "100000", "--count", "1"],
        "a camera and an angle": ["--intrinsics", "camera.json"],
        "a jitter without positions": ["--jitter", "steady"],
    }[kind]


@pytest.mark.parametrize(
    "kind",
    [
        "outside the lumen",
        "no keyframes",
        "keyframes missing",
        "NaN pose",
        "texture of text",
        "texture with many looks",
        "unknown regions",
        "nothing",
        "no field of view",
        "a picture larger than any",
        "a camera and an angle",
        "a jitter without positions",
        "other seed",
        "folder of something else",
    ],
)
def test_a_refusal_is_one_sentence_and_nothing_is_lost(kind: str, tube: Path, tmp_path, capfd) -> None:
    words = refused(kind, tube, tmp_path)
    before = content(tmp_path)
    capfd.readouterr()
    assert simulate(tube, tmp_path / "out", *words) == 2
    told = capfd.readouterr()
    assert told.out == ""
    assert re.fullmatch(r"naris: [^\n]+; [^\n]+\n", told.err), told.err
    assert content(tmp_path) == before


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_may_not_be_written(tube: Path, tmp_path, capfd) -> None:
    tmp_path.chmod(0o500)
    assert simulate(tube, tmp_path / "out", "--count", "4") == 2
    assert "Permission denied" in capfd.readouterr().err
