"""What is kept of a registration, and told of what it was made from."""

from __future__ import annotations

import hashlib
import json
import math
import os
from pathlib import Path

import pytest

from naris.anatomy.folder import load_anatomy, save_anatomy
from naris.cli import registered
from naris.cli.register import Options
from naris.cli.registered import RESULT, SCHEMAS, SHAPE, UNFINISHED, check_folder, made_from, write_registered
from naris.core.anatomy import Anatomy
from naris.core.pose import CAMERA, Pose
from naris.core.provenance import file_digest
from naris.errors import InputError
from tests.anatomy.shapes import sphere

BALL = sphere(8.0)
POSE = Pose.identity(BALL.frame, CAMERA)
RIGID = {"schema": SCHEMAS[0], "status": "registered"}


def shaped(anatomy: Anatomy) -> dict[str, object]:
    return {"schema": SCHEMAS[1], "status": "registered", "deformed": {"digest": anatomy.digest}}


def content(folder: Path) -> dict[str, str]:
    return {str(one.relative_to(folder)): file_digest(one) for one in folder.rglob("*") if one.is_file()}


def test_one_registration_takes_the_place_of_another(tmp_path: Path) -> None:
    smaller = sphere(7.0)
    write_registered(tmp_path, POSE, BALL, {"view.png": b"1", "flicker.gif": b"2"}, shaped(BALL), deformed=True)
    (tmp_path / SHAPE / ".mine").write_text("hidden")
    check_folder(tmp_path, "builtin")
    write_registered(tmp_path, POSE, smaller, {"view.png": b"3"}, shaped(smaller), deformed=True)
    assert load_anatomy(tmp_path / SHAPE, passages=False).digest == smaller.digest
    assert (tmp_path / "view.png").read_bytes() == b"3" and not (tmp_path / "flicker.gif").exists()
    check_folder(tmp_path, "builtin")
    files = write_registered(tmp_path, None, BALL, {}, RIGID)
    assert files == [str(tmp_path / RESULT), str(tmp_path / "landmarks.mrk.json")]
    assert content(tmp_path).keys() == {RESULT, "landmarks.mrk.json", f"{SHAPE}/.mine"}


@pytest.mark.parametrize("fault", ["no number", "no room", "stopped"])
def test_what_cannot_be_written_costs_nothing_that_is_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    write_registered(tmp_path, POSE, BALL, {"view.png": b"1"}, shaped(BALL), deformed=True)
    before = content(tmp_path)
    data = RIGID | {"margin": math.nan} if fault == "no number" else RIGID

    def failing(*_: object) -> None:
        raise OSError(28, "No space left on device") if fault == "no room" else KeyboardInterrupt

    if fault != "no number":
        monkeypatch.setattr("naris.register.files.write_slicer_hdf5", failing)
    with pytest.raises((ValueError, OSError, KeyboardInterrupt)):
        write_registered(tmp_path, POSE, BALL, {"view.png": b"2"}, data)
    assert content(tmp_path) == before
    assert not any(one.name.startswith(".") for one in tmp_path.iterdir())


@pytest.mark.parametrize("moved", range(5))
def test_one_that_is_killed_while_places_change_says_so_and_may_be_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, moved: int
) -> None:
    smaller, kept = sphere(7.0), []

    def killed(what: Path, where: Path) -> None:
        if len(kept) == moved:
            raise KeyboardInterrupt
        kept.append(where)
        move(what, where)

    write_registered(tmp_path, POSE, BALL, {}, shaped(BALL), deformed=True)
    move = registered._move
    monkeypatch.setattr(registered, "_move", killed)
    with pytest.raises(KeyboardInterrupt):
        write_registered(tmp_path, POSE, smaller, {}, shaped(smaller), deformed=True)
    assert json.loads((tmp_path / RESULT).read_text())["status"] == UNFINISHED
    monkeypatch.undo()
    check_folder(tmp_path, "builtin")
    write_registered(tmp_path, POSE, BALL, {}, shaped(BALL), deformed=True)
    assert load_anatomy(tmp_path / SHAPE, passages=False).digest == BALL.digest


def test_a_shape_that_a_registration_did_not_leave_is_not_replaced(tmp_path: Path) -> None:
    write_registered(tmp_path, POSE, BALL, {}, shaped(BALL), deformed=True)
    save_anatomy(sphere(7.0), tmp_path / SHAPE)
    with pytest.raises(InputError, match="an anatomy of another origin"):
        check_folder(tmp_path, "builtin")


def test_digests_of_what_was_given_are_those_of_any_shell_and_names_are_not_told(tmp_path: Path) -> None:
    folder = tmp_path / "MILLER"
    save_anatomy(BALL, folder / "nose")
    cloud = folder / "cloud"
    (cloud / "a").mkdir(parents=True)
    for name in (b"a/b", b"a-b", b"M\xfcller"):
        Path(os.fsdecode(os.fsencode(cloud) + b"/" + name)).write_bytes(name)
    (folder / "regions.json").write_text("{}")
    options = Options(str(folder / "nose"), cloud=cloud, regions=str(folder / "regions.json"), seed=3)
    told = made_from(options)
    names = sorted((b"a/b", b"a-b", b"M\xfcller"))
    lines = b"".join(hashlib.sha256(name).hexdigest().encode() + b"  " + name + b"\n" for name in names)
    assert told["options"]["cloud"] == {"sha256_of_files": hashlib.sha256(lines).hexdigest()}
    assert told["options"]["regions"] == {"sha256": file_digest(folder / "regions.json")}
    assert told["seed"] == 3 and "MILLER" not in json.dumps(told) and "regions.json" not in json.dumps(told)
    # What lies beside an anatomy in its folder, an earlier result for one, is no part of it.
    write_registered(folder / "nose" / "pose", POSE, BALL, {}, RIGID)
    for anatomy in (folder / "nose", folder / "nose" / "anatomy.json"):
        given = Options(str(anatomy), cloud=cloud, regions=str(folder / "regions.json"), seed=3)
        assert made_from(given) == told


def test_a_folder_with_the_name_of_the_built_in_nose_is_not_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    save_anatomy(BALL, tmp_path / "builtin")
    assert made_from(Options("builtin"))["options"]["anatomy"] == "builtin"
    assert "sha256_of_files" in made_from(Options("./builtin"))["options"]["anatomy"]
