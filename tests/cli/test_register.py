"""`naris register`: a pose from depth or points, what is kept of it, an honest no, and what it refuses."""

from __future__ import annotations

import json
import shutil
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import naris
from naris.anatomy.folder import load_anatomy, save_anatomy
from naris.anatomy.shape_model import ShapeModel, save_shape_model
from naris.bench.trials import drawn_trials
from naris.cli import main
from naris.cli.observed import Seen
from naris.cli.register import Options
from naris.cli.registered import SCHEMAS, UNFINISHED
from naris.cli.registration import doubts
from naris.core.anatomy import SlabRegions
from naris.core.camera import Brown, Intrinsics
from naris.core.pose import CAMERA as CAMERA_FRAME
from naris.core.pose import Pose, distance
from naris.core.provenance import file_digest
from naris.register.libraries import LIBRARIES, missing
from naris.register.observation import from_points
from naris.render.scene import Scene, render
from tests.conftest import shared_file
from tests.register.sfm.colmap_models import model_of, write_binary, write_text
from tests.register.sfm.simulated import SHOT, reconstructed
from tests.winding_tube import widening_tube

CAMERA = Intrinsics.from_vertical_fov(48, 40, 80.0)
ASIDE = Pose.exp(
    np.array([[0.0] * 6, [0.3, 0, 0.5, 0, 0.1, 0], [-0.3, 0.2, 1.0, 0.1, 0, 0]]), CAMERA_FRAME, CAMERA_FRAME
)


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
    both = render(Scene(anatomy), pose @ ASIDE, CAMERA, want=("depth",)).depth_mm
    views = [{"depth": f"rig{i}.npy", "first_T_camera": ASIDE.matrix[i].tolist()} for i in range(len(ASIDE))]
    for view, of in zip(views, both, strict=True):
        np.save(folder / view["depth"], of)
    (folder / "rig.json").write_text(json.dumps({"intrinsics": asdict(CAMERA), "views": views}))
    Image.fromarray(np.full((CAMERA.height, CAMERA.width, 3), (200, 90, 80), np.uint8)).save(folder / "frame.png")
    made, mm_per_unit = reconstructed(anatomy, pose, 3)
    write_binary(model_of(made), folder / "colmap")
    np.save(folder / "mm_per_unit.npy", mm_per_unit)
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
    assert told["expected_tre_mm"]["10 mm ahead of the camera"] > min(told["sd_mm"])
    assert told["files"] == [str(out / name) for name in sorted_files(out)]
    kept = json.loads((out / "registration.json").read_text())
    assert kept["anatomy_T_camera"] == told["anatomy_T_camera"]
    files = {"depth": seen / "depth.npy", "intrinsics": seen / "camera.json"}
    given = {name: {"sha256": file_digest(file)} for name, file in files.items()} | {"probability": 0.0}
    made = kept["made_from"]
    assert set(made["options"].pop("anatomy")) == {"sha256_of_files"}
    assert made == {"naris": naris.__version__, "seed": 0, "options": given}
    with Image.open(out / "overlay.png") as picture:
        assert picture.size == (CAMERA.width, CAMERA.height)


def test_each_pixel_may_have_a_deviation_of_its_own(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    depth = np.load(seen / "depth.npy")
    np.save(tmp_path / "sd.npy", np.where(np.arange(depth.shape[1]) < depth.shape[1] // 2, 0.2, 0.0) + 0 * depth)
    told = []
    for more in ([], ["--depth-sd", str(tmp_path / "sd.npy")]):
        assert main(words(tube, seen, "--depth", str(seen / "depth.npy"), "--probability", "0", "--json", *more)) == 0
        told.append(json.loads(capfd.readouterr().out)["rays"])
    assert told[1] == pytest.approx(told[0] / 2, rel=0.1)


def sorted_files(out: Path, *more: str) -> list[str]:
    order = ["registration.json", "landmarks.mrk.json", "anatomy_T_camera.tfm", "anatomy_T_camera.h5"]
    order += ["view.png", "overlay.png", *more]
    assert {one.name for one in out.iterdir()} == set(order)
    return order


def test_frames_with_their_poses_are_one_observation(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    arguments = ["--rig", str(seen / "rig.json"), "--frame", str(seen / "frame.png"), "-o", str(out)]
    assert main(["register", str(tube), *arguments, "--probability", "0", "--json", "--quiet"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["views"] == 3
    assert told["files"] == [str(out / name) for name in sorted_files(out, "flicker.gif")]
    with Image.open(out / "flicker.gif") as blinks, Image.open(out / "view.png") as view:
        assert blinks.n_frames == 2 and blinks.size == view.size == (CAMERA.width, CAMERA.height)
        assert np.abs(np.asarray(blinks.convert("RGB"), float) - (200, 90, 80)).max() < 8
        blinks.seek(1)
        assert np.abs(np.asarray(blinks.convert("RGB"), float) - np.asarray(view)).mean() < 6


@pytest.mark.parametrize("more", [[], ["--alone"]])
def test_a_reconstruction_is_registered_from_one_of_its_pictures(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], more: list[str]
) -> None:
    Image.fromarray(np.zeros((SHOT.height, SHOT.width, 3), np.uint8)).save(tmp_path / "frame.png")
    arguments = ["register", str(tube), "--cloud", str(seen / "colmap"), "--view", "shot 00.png", "--scale", "unknown"]
    arguments += ["--frame", str(tmp_path / "frame.png"), "-o", str(tmp_path / "out"), "--probability", "0", *more]
    assert main([*arguments, "--json", "--quiet"]) == 0
    told = json.loads(capfd.readouterr().out)
    sorted_files(tmp_path / "out", "flicker.gif")
    assert told["scale_kind"] == "unknown" and (told["views"] == 1) == bool(more)
    assert "shot" not in (tmp_path / "out" / "registration.json").read_text()  # names may tell patients
    given = told["made_from"]["options"]
    names = {"anatomy", "cloud", "view", "scale", "frame", "probability"}
    assert set(given) == names | {one.lstrip("-") for one in more}
    assert set(given["cloud"]) == {"sha256_of_files"} and given["scale"] == "unknown"
    off = np.linalg.norm(np.array(told["anatomy_T_camera"])[:3, 3] - np.load(seen / "truth.npy")[:3, 3])
    assert off < 2 or told["margin"] is not None


def test_a_folder_of_the_patient_is_no_folder_for_results(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Neither the anatomy beside which one writes, nor a deformed one that one begins from, is overwritten."""
    (tmp_path / "patient").mkdir()
    shutil.copytree(tube, tmp_path / "patient" / "anatomy")
    shutil.copytree(tube, tmp_path / "alone" / "deformed")
    shutil.copytree(tube, tmp_path / "earlier" / "deformed")
    record = {"schema": SCHEMAS[1], "deformed": {"digest": load_anatomy(str(tube)).digest}}
    (tmp_path / "earlier" / "registration.json").write_text(json.dumps(record))
    for folder in ("foreign", "rigid", "named"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "registration.json").write_text(json.dumps({"schema": SCHEMAS[0]}))
    (tmp_path / "foreign" / "deformed").mkdir()
    (tmp_path / "foreign" / "deformed" / "notes.txt").write_text("mine")
    shutil.copytree(tube, tmp_path / "rigid" / "deformed")
    (tmp_path / "named" / "view.png").mkdir()
    for folder, names in (("pictures", ("view.png", "overlay.png")), ("other", ("registration.json",))):
        (tmp_path / folder).mkdir()
        for name in names:
            (tmp_path / folder / name).write_text("{}")
    before = {one: file_digest(one) for one in tmp_path.rglob("*") if one.is_file()}
    for folder, anatomy, message in (
        ("patient", tmp_path / "patient" / "anatomy", "other files in"),
        ("alone", tube, "deformed of another origin in"),
        ("pictures", tube, "overlay.png, view.png of another origin in"),
        ("other", tube, "registration.json of another origin in"),
        ("earlier", tmp_path / "earlier" / "deformed", "an ANATOMY outside of"),
        ("foreign", tube, "got notes.txt"),
        ("rigid", tube, "got an anatomy of another origin"),
        ("named", tube, "view.png as a registration leaves it, got a folder"),
    ):
        given = ["--depth", str(seen / "depth.npy"), "-o", str(tmp_path / folder)]
        assert main(words(anatomy, seen, *given)) == 2
        assert message in capfd.readouterr().err
    assert {one: file_digest(one) for one in tmp_path.rglob("*") if one.is_file()} == before


def test_what_a_rig_names_is_part_of_what_a_pose_was_made_from(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    for file in seen.glob("rig*"):
        shutil.copy(file, tmp_path)
    made = []
    for _ in range(2):
        given = ["--rig", str(tmp_path / "rig.json"), "--probability", "0", "--json", "--quiet"]
        assert main(["register", str(tube), *given]) == 0
        made.append(json.loads(capfd.readouterr().out)["made_from"]["options"]["rig"])
        np.save(tmp_path / "rig1.npy", np.load(tmp_path / "rig1.npy") + 0.01)
    one, other = made
    assert one["sha256"] == other["sha256"] and len(one["depths"]) == len(ASIDE)
    assert [a == b for a, b in zip(one["depths"], other["depths"], strict=True)] == [True, False, True]


def test_in_another_frame_than_lps_nothing_is_kept_for_slicer(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    save_anatomy(replace(load_anatomy(str(tube)), frame="mean"), tmp_path / "mean")
    given = ["--depth", str(seen / "depth.npy"), "--probability", "0", "-o", str(tmp_path / "out")]
    assert main(words(tmp_path / "mean", seen, *given)) == 0
    assert {one.name for one in (tmp_path / "out").iterdir()} == {"registration.json", "view.png", "overlay.png"}
    assert "nothing for 3D Slicer: the anatomy is in the frame mean" in capfd.readouterr().out


@pytest.mark.parametrize("more", ["--contours", "--shading"])
def test_a_picture_that_moves_nothing_refuses_nothing(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], more: str
) -> None:
    """A pose 1 mm outside of the region that was named stands, whatever a blank picture is asked."""
    y = float(np.load(seen / "truth.npy")[1, 3])
    slabs = SlabRegions("slabs", ("before", "behind"), "LPS", 1, (y - 1.0,))
    save_anatomy(replace(load_anatomy(str(tube)), regions={"slabs": slabs}), tmp_path / "cut")
    given = ["--depth", str(seen / "depth.npy"), "--frame", str(seen / "frame.png"), "--region", "before"]
    status = main(words(tmp_path / "cut", seen, *given, "--probability", "0", "--json", more))
    told = json.loads(capfd.readouterr().out)
    assert (told[more[2:]]["used"], told[more[2:]]["moved_mm"]) == (False, 0)
    assert status == 0 and told["anatomy_T_camera"][1][3] > y - 0.9


def test_a_shape_is_refused_outside_of_the_region_that_was_named(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from naris.register.deformable import register as deformable

    monkeypatch.setattr(deformable, "refusal", lambda _: None)
    y = float(np.load(seen / "truth.npy")[1, 3])
    slabs = SlabRegions("slabs", ("before", "behind"), "LPS", 1, (y - 3.0,))
    save_anatomy(replace(load_anatomy(str(tube)), regions={"slabs": slabs}), tmp_path / "cut")
    given = ["--depth", str(seen / "depth.npy"), "--region", "before", "--modes", "2"]
    assert main(words(tmp_path / "cut", seen, *given)) == 1
    assert "not in before as was named" in capfd.readouterr().out


def test_a_region_of_another_set_is_told_where_it_is(seen: Path, capfd: pytest.CaptureFixture[str]) -> None:
    arguments = ["--cloud", str(seen / "points.txt"), "--region", "right middle meatus", "--quiet"]
    assert main(["register", "builtin", *arguments]) == 2
    assert "give --regions anatomical with it" in capfd.readouterr().err


def test_a_refusal_of_points_in_another_unit_tells_how_near_they_are(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    points = np.loadtxt(seen / "points.txt")
    hint = "where 3 to 30 are usual: check the unit"
    for unit, told in ((10.0, True), (1.0, False)):
        np.savetxt(tmp_path / "points.txt", points / unit)
        arguments = [
            "--cloud",
            str(tmp_path / "points.txt"),
            "--noise",
            str(0.1 / unit),
            "--probability",
            "1",
            "--quiet",
        ]
        assert main(["register", str(tube), *arguments]) == 1
        assert (hint in capfd.readouterr().out) == told


def test_what_was_taken_for_granted_is_told(tube: Path, seen: Path, capfd: pytest.CaptureFixture[str]) -> None:
    points = Seen(from_points(np.loadtxt(seen / "points.txt")))
    [granted] = doubts(Options("builtin", region="right vestibule", rig=Path("rig.json")), points)
    assert "in right vestibule" in granted and "poses of the cameras" in granted and "mirrored" in granted
    narrow = replace(points, intrinsics=Intrinsics.from_vertical_fov(48, 40, 45.0))
    _, lens = doubts(Options("builtin", depth=Path("depth.npy")), narrow)
    assert "a lens that sees 45°" in lens
    assert len(doubts(Options("builtin", depth=Path("depth.npy"), modes=5), narrow)) == 1
    beyond = replace(points, intrinsics=Intrinsics(64, 64, 30.0, 30.0, 31.5, 31.5, Brown(-0.3)))
    assert np.isnan(beyond.intrinsics.vertical_fov_deg)
    assert len(doubts(Options("builtin", depth=Path("depth.npy")), beyond)) == 1
    [granted] = doubts(Options("builtin", cloud=seen / "colmap"), points)
    assert "poses of the reconstruction" in granted
    for probability, status in (("0", 0), ("1", 1)):
        given = ["--cloud", str(seen / "points.txt"), "--noise", "0.1", "--probability", probability, "--quiet"]
        assert main(["register", str(tube), *given]) == status
        assert "that the points are in the frame of the camera, and not mirrored" in capfd.readouterr().out


def test_points_far_better_than_said_are_told_to_be(tube: Path, seen: Path, capfd: pytest.CaptureFixture[str]) -> None:
    given = ["--cloud", str(seen / "points.txt"), "--noise", "1", "--probability", "1", "--quiet"]
    assert main(["register", str(tube), *given]) == 1
    assert "times nearer to the walls than their noise was said to be" in capfd.readouterr().out


def test_a_principal_point_in_the_corner_is_told(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "camera.json").write_text(json.dumps(asdict(replace(CAMERA, cx=CAMERA.width - 1.0))))
    for camera, said in ((tmp_path / "camera.json", True), (seen / "camera.json", False)):
        main(["register", str(tube), "--depth", str(seen / "depth.npy"), "--intrinsics", str(camera)])
        assert ("check cx and cy" in capfd.readouterr().err) == said


def test_a_refused_pose_leaves_no_transform(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "registration.json").write_text(json.dumps({"schema": SCHEMAS[0], "status": UNFINISHED}))
    (out / "anatomy_T_camera.tfm").write_text("of a run that was broken off")
    arguments = ["--depth", str(seen / "depth.png"), "--depth-unit-mm", "0.01", "-o", str(out), "--probability"]
    assert main(words(tube, seen, *arguments, "1")) == 1
    assert capfd.readouterr().out.startswith("refused: ")
    assert {one.name for one in out.iterdir()} == {"registration.json", "landmarks.mrk.json", "refused.png"}
    assert json.loads((out / "registration.json").read_text())["anatomy_T_camera"] is None
    with Image.open(out / "refused.png") as marked:
        pixels = np.asarray(marked)
    assert (pixels[[0, -1]] == (150, 20, 20)).all() and (pixels[:, [0, -1]] == (150, 20, 20)).all()
    assert (pixels[:20] == 255).all(axis=-1).sum() > 200  # the words
    assert main(words(tube, seen, *arguments, "0")) == 0
    assert not (out / "refused.png").exists()


def test_a_cloud_needs_no_camera(tube: Path, seen: Path, capfd: pytest.CaptureFixture[str]) -> None:
    arguments = ["register", str(tube), "--cloud", str(seen / "points.txt"), "--noise", "0.1", "--json", "--quiet"]
    assert main(arguments) in (0, 1)
    told = json.loads(capfd.readouterr().out)
    assert told["scale"] == 1.0 and told["rays"] == 384
    assert (told["reason"] is None) == (told["anatomy_T_camera"] is not None)


def test_of_a_cloud_walls_are_drawn_on_the_frame_of_its_camera(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    given = ["--cloud", str(seen / "points.txt"), "--frame", str(seen / "frame.png"), "--probability", "0"]
    assert main(words(tube, seen, *given, "-o", str(tmp_path / "out"))) == 0
    sorted_files(tmp_path / "out", "flicker.gif")
    with Image.open(tmp_path / "out" / "overlay.png") as picture:
        assert picture.size == (CAMERA.width, CAMERA.height)


def test_normals_that_are_not_used_are_told(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    points = np.loadtxt(seen / "points.txt")
    np.save(tmp_path / "cloud.npy", np.hstack([points, np.tile([0.0, 0.6, -0.8], (len(points), 1))]))
    assert main(["register", str(tube), "--cloud", str(tmp_path / "cloud.npy")]) in (0, 1)
    assert "cloud.npy has normals, which are not used: --method imlop uses them" in capfd.readouterr().err


@pytest.mark.slow
def test_a_shot_of_the_mean_nose_finds_its_place(
    mean_nose_ply: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """All the way: a model of COLMAP in a unit and a world of its own, and the command line."""
    mean = load_anatomy(str(mean_nose_ply))
    (trial,) = drawn_trials(mean, 1, 5)
    made, mm_per_unit = reconstructed(mean, trial.anatomy_T_camera, 0)
    folder = write_text(model_of(made), tmp_path / "sparse")
    arguments = ["register", str(mean_nose_ply), "--cloud", str(folder), "--view", "shot 00.png", "--scale", "unknown"]
    assert main([*arguments, "--noise", f"{0.2 / mm_per_unit}", "--json", "--quiet"]) == 0
    told = json.loads(capfd.readouterr().out)
    found = Pose(np.array(told["anatomy_T_camera"]), mean.frame, CAMERA_FRAME)
    off_mm, off_rad = distance(found, trial.anatomy_T_camera)
    assert off_mm < 2 and off_rad < np.deg2rad(5)
    assert told["scale"] == pytest.approx(mm_per_unit, rel=0.05)


@pytest.mark.slow
def test_a_real_shot_of_another_person_is_refused(mean_nose_ply: Path, capfd: pytest.CaptureFixture[str]) -> None:
    shot = str(shared_file("sinus-sfm"))
    for view in ("4584", "4600", "4618"):
        arguments = ["register", str(mean_nose_ply), "--cloud", shot, "--view", view, "--scale", "unknown", "--quiet"]
        assert main(arguments) == 1
        assert capfd.readouterr().out.startswith("refused: ")


@pytest.mark.parametrize("method", ["icp", "imlop", *map(str.lower, LIBRARIES)])
def test_another_method_can_be_chosen(
    tube: Path, seen: Path, tmp_path: Path, method: str, capfd: pytest.CaptureFixture[str]
) -> None:
    points = np.loadtxt(seen / "points.txt")
    ways = points - points.mean(axis=0)
    np.savetxt(tmp_path / "cloud.txt", np.hstack([points, ways]))
    arguments = ["register", str(tube), "--cloud", str(tmp_path / "cloud.txt"), "--method", method, "--json", "--quiet"]
    more = ["--normals-deg", "60"] if method == "imlop" else []
    status, (told, error) = main([*arguments, *more]), capfd.readouterr()
    absent = next((missing(name) for name in LIBRARIES if name.lower() == method), None)
    if absent is not None:
        assert status == 2
        assert error.count("\n") == 1
        assert f"the library of the method {method}" in error
        assert f"got {absent}" in error
        assert "pip install 'naris[" in error
        return
    assert status in (0, 1)
    assert json.loads(told)["method"] == method
    off = np.linalg.norm(np.array(json.loads(told)["best_guess"])[:3, 3] - np.load(seen / "truth.npy")[:3, 3])
    assert off < 2 or json.loads(told)["margin"] is not None


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "one of --depth, --rig and --cloud, or a --frame with its --intrinsics"),
        (["--depth", "{seen}/depth.npy", "--cloud", "{seen}/points.txt"], "got --depth and --cloud"),
        (["--rig", "{seen}/rig.json"], "--intrinsics only with --depth"),
        (["--depth", "{seen}/depth.npy", "--view", "a"], "--view only with --cloud FOLDER"),
        (["--depth", "{seen}/depth.npy", "--alone"], "--alone only with --cloud FOLDER"),
        (["--depth", "{seen}/missing.npy"], "no such file"),
        (["--depth", "{seen}/camera.json"], "convert it"),
        (["--depth", "{seen}/depth.npy", "--scale-factor", "2"], "only with --scale prior"),
        (["--depth", "{seen}/depth.npy", "--scale", "prior"], "--scale-factor with --scale prior"),
        (["--depth", "{seen}/depth.npy", "--region", "liver"], "one of the regions"),
        (["--depth", "{seen}/depth.npy", "--method", "imlop"], "--cloud FILE with --method imlop"),
        (["--depth", "{seen}/depth.npy", "--method", "icp", "--scale", "unknown"], "--scale known with --method icp"),
        (["--depth", "{seen}/depth.npy", "--normals-deg", "9"], "only with --method imlop"),
        (["--depth", "{seen}/depth.npy", "--method", "open3d", "--scale", "unknown"], "--scale known with --method"),
        (["--depth", "{seen}/depth.npy", "--depth-sd", "{seen}/depth.npy", "--noise", "1"], "without --depth-sd"),
        (
            ["--cloud", "{seen}/points.txt", "--frame", "{seen}/frame.png", "--depth-sd", "a.npy"],
            "--depth-sd only with",
        ),
        (["--depth", "{seen}/depth.npy", "--model", "m"], "--frame with --model"),
        (["--depth", "{seen}/depth.npy", "--modes", "0"], "--modes"),
        (["--depth", "{seen}/depth.npy", "--modes", "5", "--probability", "0.5"], "--probability only without a shape"),
        (["--depth", "{seen}/depth.npy", "--modes", "5", "--method", "icp"], "--method naris with a shape"),
        (["--depth", "{seen}/depth.npy", "--shape-model", "{seen}"], "a shape model in"),
        (["--depth", "{seen}/depth.npy", "--depth-unit-mm", "1000"], "check the unit"),
        (
            ["--depth", "{seen}/depth.npy", "--scale", "prior", "--scale-factor", "1", "--scale-spread", "1e-300"],
            "a deviation (1e-6 to 3) for a prior",
        ),
        (
            ["--depth", "{seen}/depth.npy", "--scale", "prior", "--scale-factor", "1", "--scale-spread", "1e300"],
            "a deviation (1e-6 to 3) for a prior",
        ),
        (["--depth", "{seen}/depth.npy", "--depth-unit-mm", "40"], "mm across, got a median of"),
        (["--cloud", "{seen}/points.txt"], "--intrinsics only with the --frame of that camera beside --cloud FILE"),
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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--view", "shot 00.png"], "--scale with a reconstruction"),
        (
            ["--scale", "unknown"],
            "a view of the reconstruction (shot 00.png, shot 01.png, shot 02.png and 3 more), got none",
        ),
        (["--scale", "unknown", "--view", "a"], "got 'a'"),
        (["--scale", "unknown", "--view", "shot 00.png", "--smooth-error", "0.1"], "--smooth-error only with"),
        (["--scale", "unknown", "--view", "shot 00.png", "--frame", "{seen}/frame.png"], "a picture of 96×80 pixels"),
    ],
)
def test_of_a_reconstruction_view_and_scale_must_be_said(
    tube: Path, seen: Path, capfd: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    filled = [one.format(seen=seen) for one in arguments]
    assert main(["register", str(tube), "--cloud", str(seen / "colmap"), "--quiet", *filled]) == 2
    assert message in capfd.readouterr().err


def test_a_shape_is_estimated_with_the_pose_and_kept_beside_it(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from naris.register.deformable import register as deformable

    monkeypatch.setattr(deformable, "refusal", lambda _: None)
    out = tmp_path / "out"
    arguments = words(tube, seen, "--depth", str(seen / "depth.npy"), "--modes", "8", "-o", str(out))
    assert main([*arguments, "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["status"] == "registered" and "probability" not in told
    assert len(told["weights"]) == len(told["weight_sd"]) == 8
    assert max(told["weight_sd"]) <= 1.001 and told["scale"] == 1.0
    assert told["made_from"]["options"]["modes"] == 8
    deformed = load_anatomy(str(out / "deformed"))
    assert deformed.digest == told["deformed"]["digest"] != told["anatomy"]["digest"]
    assert deformed.region_set("slabs").names == ("one", "two", "three", "four")
    assert np.load(out / "vertex_sd_mm.npy").shape == (len(deformed.vertices_mm),)
    assert str(out / "deformed") in told["files"] and (out / "anatomy_T_camera.tfm").is_file()
    # A later one that is refused leaves nothing that looks like an answer.
    monkeypatch.setattr(deformable, "refusal", lambda _: "it is not sure")
    assert main(arguments) == 1
    assert capfd.readouterr().out.startswith("refused: it is not sure")
    assert {one.name for one in out.iterdir()} == {"registration.json", "landmarks.mrk.json"}
    assert json.loads((out / "registration.json").read_text())["anatomy_T_camera"] is None


def test_a_shape_model_goes_with_its_mean(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    mean = load_anatomy(str(tube))
    modes = 0.2 * np.stack([mean.vertex_normals, mean.vertices_mm / 40]).astype(np.float32)
    save_shape_model(ShapeModel(mean, modes, np.array([0.7, 0.3]), 5, 0.1), tmp_path / "model")
    model, depth = str(tmp_path / "model"), str(seen / "depth.npy")
    assert main(words(tube, seen, "--depth", depth, "--shape-model", model, "--json")) in (0, 1)
    assert len(json.loads(capfd.readouterr().out)["weights"]) == 2
    arguments = ["--cloud", str(seen / "points.txt"), "--shape-model", model, "--quiet"]
    save_anatomy(widening_tube(), tmp_path / "wide")
    assert main(["register", str(tmp_path / "wide"), *arguments]) == 2
    assert "the mean of the shape model" in capfd.readouterr().err


@pytest.mark.parametrize("unit", [0.02, 40.0])
def test_depth_in_a_unit_of_its_own_has_the_pose_of_that_in_mm(
    tube: Path, seen: Path, tmp_path: Path, unit: float, capfd: pytest.CaptureFixture[str]
) -> None:
    """Whatever a network calls its unit: an unknown scale is sought where walls are that an endoscope sees."""
    depth = np.load(seen / "depth.npy")
    np.save(tmp_path / "depth.npy", depth * unit)
    given = ["--depth", str(tmp_path / "depth.npy"), "--scale", "unknown", "--probability", "0", "--json"]
    assert main(words(tube, seen, *given)) in (0, 1)
    told = json.loads(capfd.readouterr().out)
    low, high = told["scale_sought"]
    assert low < 1 / unit < high
    assert told["scale_off_sd"] is None
    np.testing.assert_allclose(np.median(depth) * unit * np.array([low, high]), [3, 30], rtol=1e-6)


def test_a_scale_far_from_its_prior_is_told(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    given = ["--depth", str(seen / "depth.npy"), "--scale", "prior", "--scale-factor", "2", "--scale-spread", "0.05"]
    assert main(words(tube, seen, *given, "--probability", "0", "--json")) in (0, 1)
    told = json.loads(capfd.readouterr().out)
    off = np.log(told["scale"] / 2) / np.log1p(0.05)
    assert told["scale_off_sd"] == pytest.approx(off)
    status = main(words(tube, seen, *given, "--probability", "0"))
    says = "deviations from its prior" in capfd.readouterr().out
    assert says == (status == 0 and abs(off) > 3)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"fx": None}, "got none of fx"),
        ({"skew": 0.0}, "also skew"),
        ({"fx": "38"}, "a number for fx of the intrinsics in camera.json, got '38'"),
        ({"width": 48.5}, "a whole number for width"),
        ({"width": float("nan")}, "a whole number for width"),
        ({"height": float("inf")}, "a whole number for height"),
        ({"cx": float("nan")}, "a number for cx"),
        ({"cy": 10**400}, "a number for cy"),
        ({"lens": {"kind": ["pinhole"]}}, "a lens of the kind"),
        ({"lens": {"kind": "pinhole", "k1": 0.1}}, "the numbers of a pinhole lens"),
        ({"lens": {"kind": "mirror"}}, "a lens of the kind pinhole, brown, fisheye in camera.json, got 'mirror'"),
        ({"lens": "pinhole"}, "as objects"),
    ],
)
def test_a_camera_that_is_none_is_told_by_what_is_wrong_with_it(
    tube: Path, seen: Path, tmp_path: Path, change: dict, message: str, capfd: pytest.CaptureFixture[str]
) -> None:
    camera = {**asdict(CAMERA), **change}
    (tmp_path / "camera.json").write_text(json.dumps({k: v for k, v in camera.items() if v is not None}))
    given = ["--depth", str(seen / "depth.npy"), "--intrinsics", str(tmp_path / "camera.json"), "--quiet"]
    assert main(["register", str(tube), *given]) == 2
    assert message in capfd.readouterr().err


def test_edges_of_the_frame_may_move_the_pose(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """A tube has hardly an edge: it is said that nothing was moved, and the pose is that without."""
    given = words(tube, seen, "--depth", str(seen / "depth.npy"), "--probability", "0", "--json")
    assert main(given) == 0
    without = json.loads(capfd.readouterr().out)
    assert without["contours"] is None
    assert main([*given, "--frame", str(seen / "frame.png"), "--contours"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["contours"]["edges"] >= 0
    if not told["contours"]["used"]:
        assert told["anatomy_T_camera"] == without["anatomy_T_camera"]
    assert main([*given, "--contours"]) == 2
    assert "--frame with --contours" in capfd.readouterr().err


def test_a_picture_alone_gives_a_pose_or_an_honest_no(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """Of one colour it shows nothing, and nothing that looks like an answer is kept."""
    status = main(words(tube, seen, "--frame", str(seen / "frame.png"), "-o", str(tmp_path / "plain"), "--json"))
    told = json.loads(capfd.readouterr().out)
    assert (status, told["status"], told["picture_alone"]) == (1, "refused", True)
    assert not list((tmp_path / "plain").glob("anatomy_T_camera.*"))
    assert (tmp_path / "plain" / "refused.png").is_file()
    rgb = render(Scene(load_anatomy(str(tube))), Pose(np.load(seen / "truth.npy"), "LPS", "camera"), CAMERA).rgb
    Image.fromarray(rgb[0]).save(tmp_path / "shot.png")
    out = tmp_path / "shot"
    status = main(
        words(tube, seen, "--frame", str(tmp_path / "shot.png"), "-o", str(out), "--probability", "0", "--json")
    )
    told = json.loads(capfd.readouterr().out)
    assert (status, told["status"], told["scale_kind"]) == (0, "registered", "prior")
    assert told["files"] == [str(out / name) for name in sorted_files(out, "flicker.gif")]


@pytest.mark.parametrize(
    ("more", "expected"),
    [
        (["--noise", "0.2"], "only with --depth, --rig or --cloud"),
        (["--scale", "unknown"], "only with --depth, --rig or --cloud"),
        (["--shading"], "beside --depth, --rig or --cloud"),
        (["--modes", "5"], "one of --depth, --rig and --cloud with a shape"),
        (["--method", "icp"], "--method"),
    ],
)
def test_what_does_not_go_with_a_picture_alone_is_refused(
    tube: Path, seen: Path, more: list[str], expected: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(words(tube, seen, "--frame", str(seen / "frame.png"), *more)) == 2
    assert expected in capfd.readouterr().err


def test_a_picture_alone_needs_its_camera(tube: Path, seen: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["register", str(tube), "--frame", str(seen / "frame.png"), "--quiet"]) == 2
    assert "--intrinsics with a --frame alone" in capfd.readouterr().err


def test_shading_moves_a_pose_by_the_frame(
    tube: Path, seen: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    rgb = render(Scene(load_anatomy(str(tube))), Pose(np.load(seen / "truth.npy"), "LPS", "camera"), CAMERA).rgb
    Image.fromarray(rgb[0]).save(tmp_path / "shot.png")
    given = [
        "--depth",
        str(seen / "depth.npy"),
        "--frame",
        str(tmp_path / "shot.png"),
        "--shading",
        "--probability",
        "0",
    ]
    assert main(words(tube, seen, *given, "--json")) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["shading"]["used"]
    assert 0 < told["shading"]["moved_mm"] < 2.0
    assert told["shading"]["cost_after"] < told["shading"]["cost_before"]
    assert main(words(tube, seen, *given)) == 0
    assert "by the shading of the frame: moved by" in capfd.readouterr().out
    assert main(words(tube, seen, *given, "--contours")) == 2
    assert "one of --contours and --shading" in capfd.readouterr().err
