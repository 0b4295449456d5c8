"""`naris register`: a pose from depth or points, what is kept of it, an honest no, and what it refuses."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from naris.anatomy.folder import load_anatomy
from naris.cli import main
from naris.core.camera import Intrinsics
from naris.core.pose import Pose
from naris.render.scene import Scene, render

CAMERA = Intrinsics.from_vertical_fov(48, 40, 80.0)


@pytest.fixture(scope="module")
def seen(tube: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with what a camera in the tube sees: depth, points, the camera, and the truth."""
    folder, anatomy = tmp_path_factory.mktemp("seen"), load_anatomy(str(tube))
    passage = anatomy.passages[0]
    middle = len(passage.points_mm) // 3
    way = passage.points_mm[middle + 4] - passage.points_mm[middle]
    pose = Pose.look(passage.points_mm[middle], way, np.array([0.0, 0.0, 1.0]), anatomy.frame)
    depth = render(Scene(anatomy), pose, CAMERA, want=("depth",)).depth_mm[0]
    np.save(folder / "depth.npy", depth)
    Image.fromarray(np.rint(depth * 100).astype(np.uint16)).save(folder / "depth.png")
    np.savetxt(folder / "points.txt", (CAMERA.rays() / CAMERA.rays()[..., 2:] * depth[..., None]).reshape(-1, 3)[::5])
    (folder / "camera.json").write_text(json.dumps(asdict(CAMERA)))
    np.save(folder / "truth.npy", pose.matrix)
    return folder


def words(tube: Path, seen: Path, *more: str) -> list[str]:
    return ["register", str(tube), "--intrinsics", str(seen / "camera.json"), "--quiet", *more]


def test_depth_gives_a_pose_with_all_its_files_or_none(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    status = main(words(tube, seen, "--depth", str(seen / "depth.npy"), "-o", str(out), "--probability", "0", "--json"))
    told = json.loads(capfd.readouterr().out)
    assert status == 0
    assert told["status"] == "registered"
    off = np.linalg.norm(np.array(told["anatomy_T_camera"])[:3, 3] - np.load(seen / "truth.npy")[:3, 3])
    assert off < 0.5 or told["margin"] is not None
    assert told["files"] == [str(out / name) for name in sorted_files(out)]
    kept = json.loads((out / "registration.json").read_text())
    assert kept["anatomy_T_camera"] == told["anatomy_T_camera"]
    with Image.open(out / "overlay.png") as picture:
        assert picture.size == (CAMERA.width, CAMERA.height)


def sorted_files(out: Path) -> list[str]:
    order = ["registration.json", "landmarks.mrk.json", "anatomy_T_camera.tfm", "view.png", "overlay.png"]
    assert {one.name for one in out.iterdir()} == set(order)
    return order


def test_a_refused_pose_leaves_no_transform(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "anatomy_T_camera.tfm").write_text("of an earlier run")
    arguments = ["--depth", str(seen / "depth.png"), "--depth-unit-mm", "0.01", "--probability", "1", "-o", str(out)]
    assert main(words(tube, seen, *arguments)) == 1
    assert capfd.readouterr().out.startswith("refused: ")
    assert {one.name for one in out.iterdir()} == {"registration.json", "landmarks.mrk.json"}
    assert json.loads((out / "registration.json").read_text())["anatomy_T_camera"] is None


def test_a_cloud_needs_no_camera(tube: Path, seen: Path, capfd: pytest.CaptureFixture[str]) -> None:
    arguments = ["register", str(tube), "--cloud", str(seen / "points.txt"), "--noise", "0.1", "--json", "--quiet"]
    assert main(arguments) in (0, 1)
    told = json.loads(capfd.readouterr().out)
    assert told["scale"] == 1.0 and told["rays"] == 384
    assert (told["reason"] is None) == (told["anatomy_T_camera"] is not None)


@pytest.mark.parametrize("method", ["icp", "imlop"])
def test_another_method_can_be_chosen(
    tube: Path, seen: Path, tmp_path: Path, method: str, capfd: pytest.CaptureFixture[str]
) -> None:
    points = np.loadtxt(seen / "points.txt")
    ways = points - points.mean(axis=0)
    np.savetxt(tmp_path / "cloud.txt", np.hstack([points, ways]))
    arguments = ["register", str(tube), "--cloud", str(tmp_path / "cloud.txt"), "--method", method, "--json", "--quiet"]
    more = ["--normals-deg", "60"] if method == "imlop" else []
    assert main([*arguments, *more]) in (0, 1)
    assert json.loads(capfd.readouterr().out)["method"] == method


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "either --depth or --cloud"),
        (["--depth", "{seen}/depth.npy", "--cloud", "{seen}/points.txt"], "got both"),
        (["--depth", "{seen}/missing.npy"], "no such file"),
        (["--depth", "{seen}/camera.json"], "convert it"),
        (["--depth", "{seen}/depth.npy", "--scale-factor", "2"], "only with --scale prior"),
        (["--depth", "{seen}/depth.npy", "--scale", "prior"], "--scale-factor with --scale prior"),
        (["--depth", "{seen}/depth.npy", "--region", "liver"], "one of the regions"),
        (["--depth", "{seen}/depth.npy", "--method", "imlop"], "--cloud with --method imlop"),
        (["--depth", "{seen}/depth.npy", "--method", "icp", "--scale", "unknown"], "--scale known with --method icp"),
        (["--depth", "{seen}/depth.npy", "--normals-deg", "9"], "only with --method imlop"),
        (["--depth", "{seen}/depth.npy", "--model", "m"], "--frame with --model"),
        (["--depth", "{seen}/depth.npy", "--depth-unit-mm", "1000"], "check the unit"),
        (["--depth", "{seen}/depth.npy", "--frame", "{seen}/depth.png", "--noise", "-1"], "--noise"),
    ],
)
def test_what_cannot_be_used_is_one_sentence_and_leaves_nothing(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    out = tmp_path / "out"
    filled = [one.format(seen=seen) for one in arguments]
    assert main(words(tube, seen, *filled, "-o", str(out))) == 2
    assert message in capfd.readouterr().err
    assert not out.exists()
