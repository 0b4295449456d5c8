"""What the page asks the viewer for: pictures by our renderer, keyframes in their file, pictures along them."""

from __future__ import annotations

import io
import json
import threading
import time
import zipfile
from importlib import resources
from pathlib import Path

import numpy as np
import pytest
from fastapi.testclient import TestClient
from httpx import Response
from PIL import Image

from naris.core.anatomy import Anatomy
from naris.core.camera import Brown, Intrinsics
from naris.core.pose import Pose
from naris.core.progress import Progress
from naris.core.results import Prediction
from naris.errors import KeyframeError
from naris.render.appearance import ENDOSCOPE
from naris.render.keyframes import Keyframes, interpolate, read_keyframes, read_original_keyframes, write_keyframes
from naris.render.scene import Scene, render
from naris.serve.app import STATIC
from naris.serve.messages import SimulationAsked
from naris.serve.stage import steady
from naris.serve.viewer import Viewer


def along(anatomy: Anatomy, count: int) -> Pose:
    line = anatomy.passages[0].points_mm
    at = np.linspace(20, len(line) - 40, count).astype(int)
    return Pose.look(line[at], line[at + 10] - line[at], np.array([0.0, 0.0, 1.0]), anatomy.frame)


def rows(poses: Pose) -> list[dict[str, object]]:
    return [{"name": f"{i:02d}", "pose": poses[i].matrix.tolist()} for i in range(len(poses))]


def put(client: TestClient, body: dict[str, object]) -> Response:
    """As the page of that server does."""
    return client.put("/api/keyframes", json={"place": client.get("/api/start").json()["place"], **body})


def kept(client: TestClient, poses: Pose) -> dict[str, object]:
    """Saved as a page saves them."""
    revision = client.get("/api/keyframes").json()["revision"]
    answer = put(client, {"revision": revision, "keyframes": rows(poses)})
    assert answer.status_code == 200, answer.text
    return dict(answer.json())


@pytest.mark.parametrize("is_steady", [True, False])
def test_a_frame_is_that_of_our_renderer(client: TestClient, anatomy: Anatomy, is_steady: bool) -> None:
    pose = along(anatomy, 1)
    asked = {"pose": pose[0].matrix.tolist(), "fov_deg": 80, "width": 120, "height": 90, "steady": is_steady}
    answer = client.post("/api/frame", json=asked)
    assert answer.headers["content-type"] == "image/png"
    look = steady() if is_steady else ENDOSCOPE
    expected = render(Scene(anatomy), pose, Intrinsics.from_vertical_fov(120, 90, 80.0), look, want=("rgb",)).rgb
    assert expected is not None
    np.testing.assert_array_equal(np.asarray(Image.open(io.BytesIO(answer.content))), expected[0])


@pytest.mark.parametrize(
    ("change", "told"),
    [
        ({"pose": [[1, 0], [0, 1]]}, "a pose of 4×4 numbers"),
        ({"pose": np.diag([1.0, 1, -1, 1]).tolist()}, "a reflection"),
        ({"pose": [[1.0, 0, 0, 0]] * 4}, "a rigid transform"),
    ],
)
def test_what_is_no_pose_is_refused_in_a_sentence(client: TestClient, change: dict[str, object], told: str) -> None:
    answer = client.post("/api/frame", json=change)
    assert answer.status_code == 400
    assert answer.json()["error"].startswith("expected")
    assert told in answer.json()["error"]


@pytest.mark.parametrize("change", [{"width": 100_000}, {"fov_deg": 0}, {"pose": "x"}, {"more": 1}])
def test_what_cannot_be_asked_for_is_refused(client: TestClient, anatomy: Anatomy, change: dict[str, object]) -> None:
    asked = {"pose": along(anatomy, 1)[0].matrix.tolist()} | change
    answer = client.post("/api/frame", json=asked)
    assert answer.status_code == 422
    assert next(iter(change)) in answer.json()["error"]


@pytest.mark.parametrize("step", ["0", "1e-7", "nan", "x"])
def test_no_step_is_so_small_that_it_takes_all_memory(client: TestClient, anatomy: Anatomy, step: str) -> None:
    kept(client, along(anatomy, 2))
    assert client.get(f"/api/trajectory?step_mm={step}").status_code == 422


def test_names_that_name_no_file_are_numbered_for_the_original(client: TestClient, anatomy: Anatomy) -> None:
    named = [one | {"name": "the middle meatus"} for one in rows(along(anatomy, 3))]
    revision = client.get("/api/keyframes").json()["revision"]
    put(client, {"revision": revision, "keyframes": named})
    zipped = zipfile.ZipFile(io.BytesIO(client.get("/api/keyframes/export/original").content))
    assert [name for name in zipped.namelist() if name.endswith(".txt")] == ["00.txt", "01.txt", "02.txt"]


def test_keyframes_are_in_their_file_at_once_and_in_the_next_viewer(
    client: TestClient, viewer: Viewer, anatomy: Anatomy
) -> None:
    poses = along(anatomy, 3)
    empty = client.get("/api/keyframes").json()
    assert empty["keyframes"] == []
    told = put(client, {"revision": empty["revision"], "keyframes": rows(poses)}).json()
    assert told["revision"] != empty["revision"]
    found = read_keyframes(viewer.keyframes, anatomy)
    np.testing.assert_allclose(found.anatomy_T_camera.matrix, poses.matrix)
    again = Viewer(anatomy, anatomy.region_set(), viewer.keyframes)
    assert again.told_keyframes()["keyframes"] == told["keyframes"]
    put(client, {"revision": told["revision"], "keyframes": []})
    assert not viewer.keyframes.exists()


def test_a_page_that_was_left_behind_changes_nothing(client: TestClient, viewer: Viewer, anatomy: Anatomy) -> None:
    poses = along(anatomy, 3)
    first = kept(client, poses)
    answer = put(client, {"revision": "older", "keyframes": rows(poses[:1])})
    assert answer.status_code == 400
    assert "changed elsewhere" in answer.json()["error"]
    assert len(read_keyframes(viewer.keyframes)) == 3
    # The same once more, as after an answer that was lost, is no conflict.
    again = put(client, {"revision": "older", "keyframes": rows(poses)})
    assert again.json() == first


def test_another_program_that_writes_the_file_is_noticed(client: TestClient, viewer: Viewer, anatomy: Anatomy) -> None:
    poses = along(anatomy, 3)
    told = kept(client, poses[:1])
    write_keyframes(Keyframes.of(poses, anatomy), viewer.keyframes)
    change = {"revision": told["revision"], "keyframes": rows(poses[:2])}
    assert "changed elsewhere" in put(client, change).json()["error"]
    change["revision"] = client.get("/api/keyframes").json()["revision"]
    assert len(put(client, change).json()["keyframes"]) == 2


def test_a_file_that_cannot_be_written_is_a_sentence_and_nothing_is_said_to_be_kept(
    client: TestClient, viewer: Viewer, anatomy: Anatomy
) -> None:
    viewer.keyframes = viewer.keyframes.parent / "no-folder" / "x" / "keyframes.json"
    viewer.keyframes.parent.parent.write_text("a file")
    revision = client.get("/api/keyframes").json()["revision"]
    answer = put(client, {"revision": revision, "keyframes": rows(along(anatomy, 2))})
    assert answer.status_code == 400
    assert "--keyframes" in answer.json()["error"]
    assert client.get("/api/keyframes").json()["keyframes"] == []


def test_a_broken_keyframe_changes_nothing(client: TestClient, viewer: Viewer, anatomy: Anatomy) -> None:
    poses = along(anatomy, 2)
    told = kept(client, poses)
    broken = [{"name": "00", "pose": np.diag([1.0, 1, -1, 1]).tolist()}]
    assert put(client, {"revision": told["revision"], "keyframes": broken}).status_code == 400
    assert len(read_keyframes(viewer.keyframes)) == 2


def test_those_of_another_anatomy_are_refused_with_both_names(
    client: TestClient, anatomy: Anatomy, tmp_path: Path
) -> None:
    other = anatomy.with_(vertices_mm=anatomy.vertices_mm + 1.0, name="another tube")
    path = tmp_path / "theirs.json"
    write_keyframes(Keyframes.of(along(other, 2), other), path)
    answer = client.post("/api/keyframes/import", content=path.read_bytes())
    assert answer.status_code == 400
    assert "a winding tube" in answer.json()["error"] and "another tube" in answer.json()["error"]
    with pytest.raises(KeyframeError, match="another tube"):
        Viewer(anatomy, anatomy.region_set(), path)


def test_export_comes_back(client: TestClient, anatomy: Anatomy, tmp_path: Path) -> None:
    assert client.get("/api/keyframes/export/json").status_code == 400
    poses = along(anatomy, 3)
    kept(client, poses)
    whole = client.get("/api/keyframes/export/json").content
    assert client.post("/api/keyframes/import", content=whole).json()["keyframes"] == rows(poses)
    zipped = zipfile.ZipFile(io.BytesIO(client.get("/api/keyframes/export/original").content))
    zipped.extractall(tmp_path / "original")
    back = read_original_keyframes(tmp_path / "original", anatomy.frame)
    np.testing.assert_allclose(back.anatomy_T_camera.position_mm, poses.position_mm, atol=1e-5)
    text = (tmp_path / "original" / "01.txt").read_bytes()
    (one,) = client.post("/api/keyframes/import?name=01.txt", content=text).json()["keyframes"]
    assert one["name"] == "01"
    np.testing.assert_allclose(one["pose"], poses[1].matrix, atol=1e-5)
    assert client.post("/api/keyframes/import?name=01.txt", content=b"no pose").status_code == 400
    assert client.get("/api/keyframes/export/xml").status_code == 404


def test_beside_each_exported_text_is_the_exact_picture_through_the_lens(client: TestClient, anatomy: Anatomy) -> None:
    poses = along(anatomy, 2)
    kept(client, poses)
    whole = zipfile.ZipFile(io.BytesIO(client.get("/api/keyframes/export/original?fov_deg=80&k1=-0.1").content))
    assert sorted(whole.namelist()) == ["00.png", "00.txt", "01.png", "01.txt"]
    asked = {"fov_deg": 80, "k1": -0.1, "width": 300, "height": 300, "steady": False}
    for name, pose in zip(("00.png", "01.png"), poses.matrix.tolist(), strict=True):
        seen = client.post("/api/frame", json={"pose": pose, **asked}).content
        np.testing.assert_array_equal(Image.open(io.BytesIO(whole.read(name))), Image.open(io.BytesIO(seen)))
    assert client.get("/api/keyframes/export/original?fov_deg=500").status_code == 422


def test_keyframes_of_a_page_of_another_anatomy_or_file_are_refused(
    client: TestClient, viewer: Viewer, anatomy: Anatomy, tmp_path: Path
) -> None:
    other = Viewer(anatomy, viewer.regions, tmp_path / "elsewhere" / viewer.keyframes.name)
    assert other.place != viewer.place == Viewer(anatomy, None, viewer.keyframes).place
    empty = client.get("/api/keyframes").json()["revision"]
    body = {"place": other.place, "revision": empty, "keyframes": rows(along(anatomy, 1))}
    answer = client.put("/api/keyframes", json=body)
    assert answer.status_code == 400 and "load the page again" in answer.json()["error"]
    assert not viewer.keyframes.exists()


def test_a_zip_of_texts_comes_back_in_the_order_of_their_numbers(client: TestClient, anatomy: Anatomy) -> None:
    poses = along(anatomy, 12)
    kept(client, poses)
    whole = client.get("/api/keyframes/export/original").content
    taken = client.post("/api/keyframes/import?name=keyframes.zip", content=whole).json()["keyframes"]
    np.testing.assert_allclose([one["pose"] for one in taken], poses.matrix, atol=1e-4)
    buffer = io.BytesIO()
    with zipfile.ZipFile(io.BytesIO(whole)) as before, zipfile.ZipFile(buffer, "w") as after:
        first = before.read(before.namelist()[0])
        for name in ("10.txt", "9.txt", "read me.md"):
            after.writestr(f"folder/{name}", first)
    taken = client.post("/api/keyframes/import?name=a.ZIP", content=buffer.getvalue()).json()["keyframes"]
    assert [one["name"] for one in taken] == ["9", "10"]


def test_a_simulation_that_is_stopped_leaves_nothing(client: TestClient, viewer: Viewer, anatomy: Anatomy) -> None:
    def simulate(
        keyframes: Path, folder: Path, painted: Path | None, asked: SimulationAsked, progress: Progress
    ) -> int:
        folder.mkdir()
        with progress.task("pictures", 1000) as advance:
            for k in range(1000):
                (folder / f"{k}.png").touch()
                advance(1)
                time.sleep(0.01)
        return 1000

    viewer.simulate = simulate
    kept(client, along(anatomy, 2))
    client.post("/api/simulate", json={})
    folder = viewer.keyframes.with_name("keyframes-pictures")
    while not folder.exists():
        time.sleep(0.01)
    assert client.post("/api/simulate/stop", json={}).json()["said"] == "stopping"
    for _ in range(100):
        if not (told := client.get("/api/simulate").json())["running"]:
            break
        time.sleep(0.05)
    assert not told["running"] and "none is kept" in told["said"]
    assert not folder.exists()
    assert client.post("/api/simulate", json={}).json()["running"]  # and another may begin
    viewer.stop(wait_s=10)


def test_the_trajectory_is_that_of_simulate(client: TestClient, anatomy: Anatomy) -> None:
    poses = along(anatomy, 3)
    kept(client, poses)
    told = client.get("/api/trajectory?step_mm=2").json()["poses"]
    np.testing.assert_allclose(told, interpolate(Keyframes.of(poses, anatomy), 2.0).anatomy_T_camera.matrix)


def test_pictures_along_the_keyframes_one_work_at_a_time(client: TestClient, viewer: Viewer, anatomy: Anatomy) -> None:
    begun, may_end = threading.Event(), threading.Event()

    def simulate(
        keyframes: Path, folder: Path, painted: Path | None, asked: SimulationAsked, progress: Progress
    ) -> int:
        assert painted is None
        assert asked.camera(40, 30) == Intrinsics.from_vertical_fov(40, 30, 66.0, Brown(-0.2))
        with progress.task("pictures", 40) as advance:
            advance(10)
            begun.set()
            may_end.wait(10)
        assert len(read_keyframes(keyframes)) == 2
        return 4 * asked.per_position

    viewer.simulate = simulate
    assert client.post("/api/simulate", json={}).status_code == 400  # nothing to go along
    kept(client, along(anatomy, 2))
    assert client.post("/api/simulate", json={"per_position": 10, "fov_deg": 66, "k1": -0.2}).json()["running"]
    assert begun.wait(10)
    told = client.get("/api/simulate").json()
    assert (told["done"], told["total"], told["folder"]) == (10, 40, "keyframes-pictures")
    assert "one simulation at a time" in client.post("/api/simulate", json={}).json()["error"]
    may_end.set()
    for _ in range(100):
        if not (told := client.get("/api/simulate").json())["running"]:
            break
        time.sleep(0.05)
    assert told["said"] == "40 pictures in keyframes-pictures"


def test_what_a_model_says_of_pictures_and_poses(client: TestClient, viewer: Viewer, anatomy: Anatomy) -> None:
    seen: list[np.ndarray] = []

    def locate(image: np.ndarray) -> Prediction:
        seen.append(image)
        return Prediction("slabs", ("one", "two"), np.log([0.25, 0.75]), along(anatomy, 2), np.array([0.6, 0.4]))

    pose = along(anatomy, 1)[0].matrix.tolist()
    assert "--model" in client.post("/api/believed", json={"pose": pose}).json()["error"]
    viewer.locate, viewer.model_camera = locate, Intrinsics.from_vertical_fov(100, 80, 60.0)
    told = client.post("/api/believed", json={"pose": pose}).json()
    assert seen[0].shape == (80, 100, 3)
    assert told["probabilities"] == pytest.approx([0.25, 0.75])
    np.testing.assert_allclose(told["hypotheses"][1]["pose"], along(anatomy, 2)[1].matrix)
    buffer = io.BytesIO()
    picture = np.random.default_rng(0).integers(0, 255, (60, 70, 3), dtype=np.uint8)
    Image.fromarray(picture).save(buffer, "PNG")
    client.post("/api/locate", content=buffer.getvalue())
    np.testing.assert_array_equal(seen[1], picture)
    answer = client.post("/api/locate", content=json.dumps({"no": "picture"}).encode())
    assert answer.status_code == 400 and "a picture" in answer.json()["error"]


def test_all_that_the_page_is_made_of_is_served_and_nothing_else() -> None:
    folder = resources.files("naris.serve").joinpath("static")
    there = {one.name for one in folder.iterdir() if one.is_file()}
    vendored = {f"vendor/{one.name}" for one in folder.joinpath("vendor").iterdir() if one.name.endswith(".js")}
    assert {name for name, _ in STATIC.values()} == there | vendored


def test_parcels_that_are_made_ahead_are_those_that_are_asked_for(viewer: Viewer, anatomy: Anatomy) -> None:
    viewer.prepare()
    for _ in range(200):
        if set(viewer._made) == set(Viewer.PARCELS):
            break
        time.sleep(0.05)
    assert viewer._made == {
        name: Viewer(anatomy, viewer.regions, viewer.keyframes).parcel(name) for name in Viewer.PARCELS
    }
