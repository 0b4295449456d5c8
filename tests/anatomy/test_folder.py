"""A whole anatomy on disk: it comes back as it went, damage is told, and nothing is lost on the way."""

import errno
import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from naris.anatomy.folder import DESCRIPTION, load_anatomy, remove_anatomy, save_anatomy
from naris.anatomy.regions import PAPER_SLABS, whole, write_regions
from naris.core.anatomy import Between, Enclosed, Entrance, GridRegions, Passage, SlabRegions
from naris.errors import DiskFull, RegionError, SurfaceError

from .shapes import sphere, torus, tube


def full_anatomy():
    rng = np.random.default_rng(0)
    labels = rng.integers(-1, 2, (4, 5, 6)).astype(np.int8)
    return torus().with_(
        name="a torus, ü",
        source="made for a test",
        vertices_mm=torus().vertices_mm + 1e-9,
        regions={
            "slabs": SlabRegions("slabs", ("front", "back"), "LPS", 1, (0.25,)),
            "grid": GridRegions("grid", ("a", "b"), "LPS", labels, rng.normal(size=3), 0.6),
        },
        passages=(Passage("main", rng.normal(size=(7, 3)), rng.uniform(size=7)),),
        landmarks_mm={"left nostril centre": rng.normal(size=3)},
        airspace=Between(7.5, Entrance((-1.0, -2.0, -3.0), (1.0, 2.0, 3.0))),
    )


def same(a, b):
    assert (a.digest, a.frame, a.name, a.source, a.airspace) == (b.digest, b.frame, b.name, b.source, b.airspace)
    np.testing.assert_array_equal(a.vertices_mm, b.vertices_mm)
    np.testing.assert_array_equal(a.faces, b.faces)
    assert list(a.regions) == list(b.regions)
    probe = np.random.default_rng(1).uniform(-5, 5, (500, 3))
    for name in a.regions:
        assert a.regions[name].names == b.regions[name].names
        np.testing.assert_array_equal(a.regions[name].label(probe), b.regions[name].label(probe))
    for one, other in zip(a.passages, b.passages, strict=True):
        assert one.name == other.name
        np.testing.assert_array_equal(one.points_mm, other.points_mm)
        np.testing.assert_array_equal(one.clearance_mm, other.clearance_mm)
    assert list(a.landmarks_mm) == list(b.landmarks_mm)
    for name in a.landmarks_mm:
        np.testing.assert_array_equal(a.landmarks_mm[name], b.landmarks_mm[name])


@pytest.mark.parametrize("airspace", [Enclosed(), Between(), full_anatomy().airspace], ids=["enclosed", "plain", "box"])
def test_what_was_saved_is_loaded(tmp_path, airspace):
    anatomy = full_anatomy().with_(airspace=airspace)
    save_anatomy(anatomy, tmp_path / "a")
    same(load_anatomy(tmp_path / "a"), anatomy)
    same(load_anatomy(tmp_path / "a" / DESCRIPTION), anatomy)


def test_saving_twice_gives_the_same_bytes(tmp_path):
    for name in ("a", "b"):
        save_anatomy(full_anatomy(), tmp_path / name)
    files = {p.name: p.read_bytes() for p in (tmp_path / "a").iterdir()}
    assert files == {p.name: p.read_bytes() for p in (tmp_path / "b").iterdir()}
    assert len(files) == 2


def test_another_anatomy_takes_the_place_of_the_first_and_other_files_stay(tmp_path):
    save_anatomy(full_anatomy(), tmp_path)
    (tmp_path / "notes.txt").write_text("mine")
    save_anatomy(sphere(), tmp_path)
    same(load_anatomy(tmp_path, passages=False).with_(regions={}), sphere())
    assert (tmp_path / "notes.txt").read_text() == "mine"
    assert len(list(tmp_path.glob("*.ply"))) == 1


def test_a_folder_with_other_things_is_left_alone(tmp_path):
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(SurfaceError, match=r"one with notes\.txt"):
        save_anatomy(sphere(), tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


def test_a_save_that_was_stopped_is_no_obstacle(tmp_path):
    (tmp_path / "surface-01234567.ply").write_bytes(b"ply")
    (tmp_path / ".hidden").write_text("")
    save_anatomy(sphere(), tmp_path)
    same(load_anatomy(tmp_path, passages=False).with_(regions={}), sphere())


def test_when_the_disk_is_full_the_first_anatomy_is_still_there(tmp_path, monkeypatch):
    save_anatomy(full_anatomy(), tmp_path)
    real = Path.write_bytes

    def write_bytes(path, content):
        if "anatomy" in path.name:
            raise OSError(errno.ENOSPC, "No space left on device")
        return real(path, content)

    monkeypatch.setattr(Path, "write_bytes", write_bytes)
    with pytest.raises(DiskFull):
        save_anatomy(sphere(), tmp_path)
    same(load_anatomy(tmp_path), full_anatomy())


def spoil(folder, **changes):
    path = folder / DESCRIPTION
    path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))


@pytest.mark.parametrize(
    "changes",
    [
        {"schema": "naris.anatomy/99"},
        {"surface": {"file": "../elsewhere.ply", "sha256": "0"}},
        {"surface": {"file": "absent.ply", "sha256": "0"}},
        {"surface": None},
        {"regions": [{"kind": "slabs"}]},
        {"passages": [{"name": "p", "points_mm": [[0, 0, 0]], "clearance_mm": [1, 2]}]},
        {"passages": 5},
        {"landmarks_mm": {"a": [1, 2]}},
        {"airspace": {"kind": "vacuum"}},
        {"airspace": {"kind": "between", "ball_mm": 3, "entrance": {"low_mm": [0]}}},
        {"landmarks_mm": [1]},
    ],
)
def test_a_spoiled_description_is_refused(tmp_path, changes):
    save_anatomy(full_anatomy(), tmp_path)
    spoil(tmp_path, **changes)
    with pytest.raises((SurfaceError, RegionError)) as caught:
        load_anatomy(tmp_path)
    assert "\n" not in str(caught.value)


def test_a_damaged_surface_is_refused(tmp_path):
    save_anatomy(full_anatomy(), tmp_path)
    (surface,) = tmp_path.glob("*.ply")
    surface.write_bytes(surface.read_bytes()[:-1])
    with pytest.raises(SurfaceError, match="as it was saved"):
        load_anatomy(tmp_path)


def test_what_is_no_anatomy_is_refused(tmp_path):
    with pytest.raises(SurfaceError, match="got none"):
        load_anatomy(tmp_path)
    (tmp_path / DESCRIPTION).write_text("no JSON")
    with pytest.raises(SurfaceError, match="JSON"):
        load_anatomy(tmp_path)
    with pytest.raises(SurfaceError, match="builtin"):
        load_anatomy("buitlin")
    with pytest.raises(SurfaceError, match="nothing there"):
        load_anatomy(tmp_path / "absent.ply")
    (tmp_path / "file").write_text("")
    with pytest.raises(SurfaceError, match="a file"):
        save_anatomy(sphere(), tmp_path / "file")


def test_a_bare_surface_gets_passages_and_one_region(tmp_path):
    trimesh.Trimesh(tube().vertices_mm, tube().faces, process=False).export(tmp_path / "tube.ply")
    anatomy = load_anatomy(tmp_path / "tube.ply")
    assert list(anatomy.regions) == ["whole"]
    assert [p.name for p in anatomy.passages] == ["main"]
    assert load_anatomy(tmp_path / "tube.ply", passages=False).passages == ()


def test_regions_can_be_told(tmp_path):
    trimesh.Trimesh(tube().vertices_mm, tube().faces, process=False).export(tmp_path / "tube.ply")
    slabs = load_anatomy(tmp_path / "tube.ply", regions="slabs", passages=False).region_set()
    assert len(slabs.names) == 4
    mine = SlabRegions("mine", ("front", "back"), "LPS", 1, (0.0,))
    write_regions(mine, tmp_path / "mine.json")
    assert load_anatomy(tmp_path / "tube.ply", regions=tmp_path / "mine.json", passages=False).region_set() == mine
    both = load_anatomy(tmp_path / "tube.ply", regions=whole("LPS"), passages=False)
    save_anatomy(both, tmp_path / "saved")
    assert list(load_anatomy(tmp_path / "saved", regions=mine, passages=False).regions) == ["mine", "whole"]
    with pytest.raises(RegionError, match="'mean'"):
        load_anatomy(tmp_path / "tube.ply", regions=PAPER_SLABS, passages=False)


@pytest.mark.slow
def test_the_mean_nose_comes_with_all_that_is_known(mean_nose, mean_nose_ply, tmp_path):
    anatomy = load_anatomy(mean_nose_ply)
    assert anatomy.digest == mean_nose[0].digest
    assert [p.name for p in anatomy.passages][:1] == ["main"]
    save_anatomy(anatomy, tmp_path)
    same(load_anatomy(tmp_path), anatomy)


@pytest.mark.slow
def test_the_built_in_nose_goes_by_its_word(tmp_path):
    nose = load_anatomy("builtin")
    assert nose.name == "built-in nose"
    assert nose.passages
    save_anatomy(nose, tmp_path)
    same(load_anatomy(tmp_path), nose)


def test_an_anatomy_is_taken_away_and_nothing_else(tmp_path):
    save_anatomy(sphere(), tmp_path / "own")
    remove_anatomy(tmp_path / "own")
    assert not (tmp_path / "own").exists()
    save_anatomy(sphere(), tmp_path / "shared")
    (tmp_path / "shared" / "notes.txt").write_text("mine")
    remove_anatomy(tmp_path / "shared")
    assert [one.name for one in (tmp_path / "shared").iterdir()] == ["notes.txt"]
    remove_anatomy(tmp_path / "nowhere")
