"""`naris anatomy`: what it tells of good surfaces, and its one sentence for each bad one."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from naris.anatomy.folder import load_anatomy
from naris.anatomy.ply import write_surface
from naris.cli import main
from tests.winding_tube import RADIUS_MM, winding_tube


@pytest.fixture
def surface(tmp_path) -> Path:
    """The bare surface of the tube: nothing but a mesh."""
    path = tmp_path / "tube.ply"
    write_surface(winding_tube(), path)
    return path


def test_a_bare_surface_is_told_kept_and_opened_again(surface: Path, tmp_path, capfd) -> None:
    kept = tmp_path / "kept"
    assert main(["anatomy", str(surface), "--regions", "slabs", "-o", str(kept), "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    tube = winding_tube()
    assert (told["closed"], told["pieces"], told["genus"]) == (True, 1, 0)
    assert told["digest"] == load_anatomy(kept).digest == tube.digest
    length_mm = tube.passages[0].length_mm
    assert told["volume_ml"] == pytest.approx(np.pi * RADIUS_MM**2 * (length_mm + 4 / 3 * RADIUS_MM) / 1000, rel=0.03)
    assert told["passages"][0]["length_mm"] == pytest.approx(length_mm, rel=0.15)
    assert list(told["regions"]) == ["slabs"]
    assert main(["anatomy", str(kept), "--json"]) == 0
    again = json.loads(capfd.readouterr().out)
    assert {**again, "folder": told["folder"], "picture": told["picture"]} == told


def test_the_picture_needs_nothing_from_elsewhere(tube: Path, tmp_path) -> None:
    assert main(["anatomy", str(tube), "-o", str(tmp_path / "kept"), "--quiet"]) == 0
    page = (tmp_path / "kept" / "anatomy.html").read_text()
    assert "a winding tube" in page
    assert "data:image/" in page
    links = re.findall(r"""(?:src|href|url)\s*[=(]\s*["']?([^"')> ]+)""", page)
    assert all(link.startswith(("data:", "#")) for link in links), links


def test_text_for_people(tube: Path, capfd) -> None:
    assert main(["anatomy", str(tube)]) == 0
    told = capfd.readouterr().out
    for word in (
        "a winding tube",
        "closed, one piece, genus 0, no face crosses another",
        "regions slabs: one, two, three, four",
        "passage main",
    ):
        assert word in told


def test_a_surface_that_passes_through_itself_is_told(surface: Path, capfd) -> None:
    """A patch of the wall pushed out through the wall on the other side."""
    tube = winding_tube()
    middle = tube.vertices_mm[len(tube.vertices_mm) // 2]
    patch = np.linalg.norm(tube.vertices_mm - middle, axis=1) < 2.0
    inwards = -tube.vertex_normals[len(tube.vertices_mm) // 2]
    write_surface(tube.with_(vertices_mm=tube.vertices_mm + 3 * RADIUS_MM * patch[:, None] * inwards), surface)
    assert main(["anatomy", str(surface), "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["crossings"] >= told["crossing_faces"] / 2 > 4
    assert main(["anatomy", str(surface)]) == 0
    assert f"{told['crossing_faces']:,} faces cross others" in capfd.readouterr().out


def test_an_inside_out_surface_is_turned_with_a_notice(surface: Path, tmp_path, capfd) -> None:
    tube = winding_tube()
    write_surface(tube.with_(faces=tube.faces[:, ::-1].copy()), surface)
    assert main(["anatomy", str(surface), "--json"]) == 0
    told = capfd.readouterr()
    assert json.loads(told.out)["volume_ml"] > 0
    assert "inside out" in told.err


def test_another_unit_on_request(surface: Path, capfd) -> None:
    tube = winding_tube()
    write_surface(tube.with_(vertices_mm=tube.vertices_mm / 1000), surface)
    assert main(["anatomy", str(surface)]) == 2
    assert re.search(
        r"as if it were in metres; bring it to mm first: naris anatomy \S+ --unit m -o DIR$",
        capfd.readouterr().err.strip(),
    )
    assert main(["anatomy", str(surface), "--unit", "m", "--json"]) == 0
    assert json.loads(capfd.readouterr().out)["bounds_mm"]["high"][1] == pytest.approx(tube.bounds_mm[1, 1], abs=1e-3)


def test_unit_and_frame_of_a_kept_anatomy_are_known(tube: Path, capfd) -> None:
    for what in (tube, tube / "anatomy.json"):
        assert main(["anatomy", str(what), "--unit", "mm", "--frame", "LPS"]) == 2
        assert re.search(
            r"expected --unit, --frame only with a surface file, got .*; leave them out", capfd.readouterr().err
        )


def bad_surface(kind: str, folder: Path) -> str:
    path, tube = folder / "bad.ply", winding_tube()
    if kind == "text":
        path.write_text("this is not a mesh\n")
    elif kind == "empty":
        path.write_bytes(b"")
    elif kind == "open":
        write_surface(tube.with_(faces=tube.faces[10:].copy()), path)
    elif kind == "metres":
        write_surface(tube.with_(vertices_mm=tube.vertices_mm / 1000), path)
    elif kind == "truncated":
        write_surface(tube, path)
        path.write_bytes(path.read_bytes()[:-1000])
    elif kind == "picture":
        path = folder / "bad.png"
        path.write_bytes(b"\x89PNG")
    elif kind == "damaged folder":
        main(["anatomy", _saved(tube, folder), "-o", str(folder / "kept"), "--quiet", "--regions", "slabs"])
        next((folder / "kept").glob("*.ply")).unlink()
        path = folder / "kept"
    return str(path)


def _saved(tube, folder: Path) -> str:
    write_surface(tube, folder / "good.ply")
    return str(folder / "good.ply")


@pytest.mark.parametrize(
    "kind", ["text", "empty", "open", "metres", "truncated", "picture", "missing", "damaged folder"]
)
def test_a_bad_surface_gets_one_sentence(kind: str, tmp_path, capfd) -> None:
    what = bad_surface(kind, tmp_path)
    capfd.readouterr()
    assert main(["anatomy", what, "--quiet", "-o", str(tmp_path / "out")]) == 2
    told = capfd.readouterr()
    assert told.out == ""
    assert re.fullmatch(r"naris: [^\n]+; [^\n]+\n", told.err), told.err
    assert not (tmp_path / "out").exists()


def test_regions_that_are_not_there(tube: Path, tmp_path, capfd) -> None:
    assert main(["anatomy", str(tube), "--regions", "nope"]) == 2
    assert "'slabs'" in capfd.readouterr().err
    assert main(["anatomy", str(tube), "--regions", str(tmp_path / "none.json")]) == 2
    assert capfd.readouterr().err.count("\n") == 1


@pytest.mark.slow
def test_the_built_in_nose_takes_parameters(capfd) -> None:
    lengths = []
    for setting in ([], ["--set", "cavity_length_mm=80"]):
        assert main(["anatomy", "builtin", "--json", *setting]) == 0
        told = json.loads(capfd.readouterr().out)
        assert told["closed"]
        lengths.append(told["bounds_mm"]["high"][1] - told["bounds_mm"]["low"][1])
    assert lengths[1] - lengths[0] == pytest.approx(8, abs=1.5)


@pytest.mark.parametrize(
    ("setting", "says"),
    [
        ("no_such_mm=3", "cavity_length_mm"),
        ("cavity_length_mm=long", "a number for cavity_length_mm"),
        ("cavity_length_mm=500", "adults have"),
    ],
)
def test_a_wrong_parameter_gets_one_sentence(setting: str, says: str, capfd) -> None:
    assert main(["anatomy", "builtin", "--set", setting]) == 2
    told = capfd.readouterr().err
    assert says in told
    assert told.count("\n") == 1
