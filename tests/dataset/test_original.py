"""Writing the original's folders: nothing half-done is lost, nothing of others is touched."""

from __future__ import annotations

from pathlib import Path

import pytest

from naris.dataset.generate import simulate
from naris.dataset.original import FRAMES, check_original, write_original
from naris.dataset.read import Dataset
from naris.errors import DatasetError
from tests.dataset.small import hashes, small_simulation


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Dataset:
    return simulate(small_simulation(12, 16), tmp_path_factory.mktemp("made") / "set", workers=1)


def test_a_stopped_export_goes_on_and_a_whole_one_is_left_alone(data: Dataset, tmp_path: Path) -> None:
    write_original(data, tmp_path)
    whole = hashes(tmp_path)
    assert len(whole) == 24
    for lost in ("frame/07.png", "pose/07.txt", "pose/00.txt"):
        (tmp_path / lost).unlink()
    (tmp_path / FRAMES / ".07.1234abcd.part.png").write_bytes(b"half a picture of a run that was killed")
    kept = {path: path.stat().st_mtime_ns for path in tmp_path.rglob("[0-9]*")}
    for _ in range(2):
        write_original(data, tmp_path)
        assert hashes(tmp_path) == whole
    assert {path: path.stat().st_mtime_ns for path in kept} == kept


@pytest.mark.parametrize("other", ["frame/00.png", "pose/11.txt", "frame/12.png", "pose/notes.txt"])
def test_other_files_are_refused_and_nothing_is_touched(data: Dataset, tmp_path: Path, other: str) -> None:
    (tmp_path / other).parent.mkdir()
    (tmp_path / other).write_text("of another data set")
    before = hashes(tmp_path)
    with pytest.raises(DatasetError, match=f"another {other}.*another folder"):
        write_original(data, tmp_path)
    assert hashes(tmp_path) == before


def test_a_folder_is_judged_before_the_pictures_are_made(data: Dataset, tmp_path: Path) -> None:
    none = [tmp_path / f"none-{i}.png" for i in range(len(data))]
    check_original(tmp_path / "theirs", data.anatomy_T_camera, none)
    assert not (tmp_path / "theirs").exists()
    write_original(data, tmp_path / "theirs")
    check_original(tmp_path / "theirs", data.anatomy_T_camera, data.image_files)
    with pytest.raises(DatasetError, match=r"frame/00\.png"):
        check_original(tmp_path / "theirs", data.anatomy_T_camera, none)
    with pytest.raises(DatasetError, match=r"pose/00\.txt"):
        check_original(tmp_path / "theirs", data.anatomy_T_camera[::-1], data.image_files)
    (tmp_path / "file").touch()
    with pytest.raises(DatasetError, match="a file"):
        check_original(tmp_path / "file", data.anatomy_T_camera, none)
