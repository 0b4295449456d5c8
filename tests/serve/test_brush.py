"""Painting regions: what a stroke reaches, taking it back, and the set that is written."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from fastapi.testclient import TestClient

from naris.anatomy.regions import read_regions
from naris.core.anatomy import NOWHERE, Anatomy, GridRegions
from naris.core.pose import Pose
from naris.errors import RegionError
from naris.serve.brush import Brush
from naris.serve.stage import places
from naris.serve.viewer import Viewer
from tests import simulated_head
from tests.serve.test_parcel import read as unpacked


@pytest.fixture
def brush(anatomy: Anatomy) -> Brush:
    return Brush(anatomy, anatomy.region_set())


def middle(anatomy: Anatomy) -> np.ndarray:
    line = anatomy.passages[0].points_mm
    return np.asarray(line[len(line) // 2])


def test_before_a_stroke_places_in_the_air_have_the_region_that_they_had(anatomy: Anatomy, brush: Brush) -> None:
    points = anatomy.passages[0].points_mm
    was = anatomy.region_set().label(points)
    # The nearest node tells: but for places right at a border it is the same.
    assert (brush.regions.label(points) == was).mean() > 0.97
    assert brush.regions.names == anatomy.region_set().names


def test_before_a_stroke_no_border_of_a_grid_moves() -> None:
    nose = simulated_head.nose()
    regions = next(one for one in nose.regions.values() if isinstance(one, GridRegions))
    brush = Brush(nose, regions)
    assert brush.regions.spacing_mm <= 0.5 < 2 * regions.spacing_mm
    points = np.random.default_rng(0).uniform(*nose.bounds_mm, (20_000, 3))
    np.testing.assert_array_equal(brush.regions.label(points), regions.label(points))
    np.testing.assert_array_equal(brush.regions.label(nose.vertices_mm), regions.label(nose.vertices_mm))


def test_a_stroke_paints_a_ball_and_nothing_else(anatomy: Anatomy, brush: Brush) -> None:
    before, at = brush.regions.labels.copy(), middle(anatomy)
    number = (int(brush.regions.label(at)) + 1) % 4
    changed = brush.paint(number, 2.0, [at.tolist()])
    regions = brush.regions
    different = np.argwhere(regions.labels != before)
    assert changed == len(different) > 0
    off = np.linalg.norm(regions.origin_mm + regions.spacing_mm * different - at, axis=1)
    assert off.max() <= 2.0 and regions.label(at) == number
    assert (regions.labels[before == NOWHERE] == NOWHERE).all()


def test_nothing_behind_a_wall_is_painted() -> None:
    nose = simulated_head.nose()
    brush = Brush(nose, nose.region_set())
    left, right = (next(one for one in nose.passages if side in one.name) for side in ("left", "right"))
    apart = np.linalg.norm(left.points_mm[:, None] - right.points_mm[None], axis=2)
    # Beside the septum: behind the choanae both passages are one.
    i = int(np.flatnonzero((apart.min(axis=1) > 3.0) & (apart.min(axis=1) < 9.0))[0])
    one, other = left.points_mm[i], right.points_mm[int(apart[i].argmin())]
    was = brush.regions.label(other)
    number = (int(was) + 1) % len(brush.regions.names)
    brush.paint(number, float(np.linalg.norm(one - other)) + 1.0, [one.tolist()])
    assert brush.regions.label(one) == number and brush.regions.label(other) == was


def test_strokes_are_taken_back_the_last_one_first(anatomy: Anatomy, brush: Brush) -> None:
    states, at = [brush.regions.labels.copy()], middle(anatomy)
    was = int(brush.regions.label(at))
    for number in (was + 1, was + 2):
        assert brush.paint(number % 4, 3.0, [at.tolist(), (at + [0, 2, 0]).tolist()]) > 0
        states += [brush.regions.labels.copy()]
    for strokes, expected in zip((2, 1), states[-2::-1], strict=True):
        assert brush.undo(strokes) > 0
        np.testing.assert_array_equal(brush.regions.labels, expected)
        assert brush.undo(strokes) == 0  # the same request again
    assert brush.undo(0) == 0


def test_strokes_far_away_and_regions_that_are_none(anatomy: Anatomy, brush: Brush) -> None:
    assert brush.paint(0, 3.0, [[1e6, 0.0, 0.0], [-1e6, 0.0, 0.0]]) == 0
    assert brush.undo(0) == 0 and brush.is_saved
    with pytest.raises(RegionError, match="a region from 0 to 3, got 4"):
        brush.paint(4, 3.0, [middle(anatomy).tolist()])


def test_the_page_paints_and_what_it_saves_is_a_region_set(
    client: TestClient, viewer: Viewer, anatomy: Anatomy, tmp_path: Path
) -> None:
    at = middle(anatomy)
    number = (int(anatomy.region_set().label(at)) + 1) % 4
    answer = client.post("/api/regions/paint", json={"region": number, "radius_mm": 4, "points": [at.tolist()]})
    assert answer.status_code == 200, answer.text
    about, arrays = unpacked(answer.content)
    assert about["changed"] > 0 and about["undoable"] == 1 and not about["saved"]
    # Whoever loads the page now sees the same.
    surface = unpacked(client.get("/api/parcel/surface").content)
    np.testing.assert_array_equal(surface[1]["region"], arrays["surface"])
    np.testing.assert_array_equal(unpacked(client.get("/api/parcel/room").content)[1]["region"], arrays["room"])
    assert surface[0]["places"] == about["places"]
    files = [client.post("/api/regions/save").json()["file"] for _ in range(2)]
    assert client.get("/api/start").json()["brush"]["saved"]
    for path, body in (
        ("paint", {"region": (number + 1) % 4, "radius_mm": 4, "points": [at.tolist()]}),
        ("undo", {"strokes": 2}),
    ):
        client.post(f"/api/regions/{path}", json=body)
    files.append(client.post("/api/regions/save").json()["file"])  # as it was: in the same file
    assert files == 3 * ["regions-1.json"] and viewer.painted_file() == tmp_path / files[0]
    saved = read_regions(tmp_path / files[0])
    assert isinstance(saved, GridRegions) and saved.frame == anatomy.frame and saved.label(at) == number
    assert saved.name != anatomy.region_set().name
    assert viewer.regions is not None
    np.testing.assert_array_equal(saved.label(anatomy.vertices_mm), viewer.regions.label(anatomy.vertices_mm))
    assert client.get("/api/start").json()["brush"]["undoable"] == 1
    undone = unpacked(client.post("/api/regions/undo", json={"strokes": 1}).content)
    assert undone[0]["undoable"] == 0
    again = unpacked(client.post("/api/regions/undo", json={"strokes": 1}).content)
    assert again[0]["changed"] == 0
    assert client.post("/api/regions/save").json()["file"] == "regions-2.json"


@pytest.mark.parametrize(
    "stroke",
    [
        {"region": 9, "radius_mm": 3, "points": [[0, 0, 0]]},
        {"region": 0, "radius_mm": -1, "points": [[0, 0, 0]]},
        {"region": 0, "radius_mm": 3, "points": [[0, 0]]},
        {"region": 0, "radius_mm": 3, "points": [[0, 0, 0]] * 3000},
    ],
)
def test_strokes_that_are_none_are_refused_in_a_sentence(client: TestClient, stroke: dict[str, object]) -> None:
    answer = client.post("/api/regions/paint", json=stroke)
    assert answer.status_code in (400, 422) and answer.json()["error"].count("\n") == 0


def test_without_regions_there_is_nothing_to_paint(anatomy: Anatomy, tmp_path: Path) -> None:
    with pytest.raises(RegionError, match="start naris steer with --regions slabs"):
        Viewer(anatomy, None, tmp_path / "keyframes.json").save_regions()


def test_a_folder_that_cannot_be_written_is_told(anatomy: Anatomy, brush: Brush, tmp_path: Path) -> None:
    (tmp_path / "a file").write_text("")
    with pytest.raises(RegionError, match="to write regions-1"):
        brush.save(tmp_path / "a file")


def test_regions_after_a_stroke_are_entered_where_they_are(viewer: Viewer, anatomy: Anatomy) -> None:
    """A region that is painted over is none that one can fly into."""
    assert viewer.regions is not None
    whole = anatomy.passages[0].points_mm[::2]
    brush = Brush(anatomy, viewer.regions)
    brush.paint(1, 20.0, whole.tolist())
    names = {one.name for one in places(anatomy, brush.regions) if one.kind == "region"}
    assert names == {viewer.regions.names[1]}
    pose = next(one.anatomy_T_camera for one in places(anatomy, brush.regions) if one.kind == "region")
    assert isinstance(pose, Pose) and brush.regions.label(pose.position_mm) == 1
