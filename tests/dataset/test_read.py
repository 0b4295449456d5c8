"""Reading a data set, and the sentences about one that is broken."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from naris.core.anatomy import SlabRegions
from naris.core.camera import Brown, Fisheye, Intrinsics, Pinhole
from naris.dataset.generate import simulate
from naris.dataset.layout import RegionLabels, intrinsics_from_json, intrinsics_to_json
from naris.dataset.original import read_original, write_original
from naris.dataset.pictures import encode_rgb, read_depth, read_rgb
from naris.dataset.read import Dataset
from naris.errors import DatasetError, ImageError
from naris.render.scene import Scene
from tests.dataset.small import small_simulation
from tests.winding_tube import SLABS, winding_tube


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("made") / "set"
    simulate(small_simulation(12), folder, scene=Scene(winding_tube()))
    return folder


@pytest.fixture
def broken(made, tmp_path) -> Path:
    """A copy to break."""
    return Path(shutil.copytree(made, tmp_path / "set"))


def test_all_of_it(made) -> None:
    data = Dataset.open(made)
    assert len(data) == 12
    assert data.images().shape == (12, 40, 40, 3)
    assert np.array_equal(data.images([3, 1])[0], data[3].frame.image)
    assert np.array_equal(data[-1].frame.image, data[11].frame.image)
    assert data.regions.names == SLABS.names
    assert np.array_equal(data.regions.neighbours, SLABS.neighbours)
    assert data.anatomy_digest == winding_tube().digest
    assert np.array_equal(data.labels, SLABS.label(data.anatomy_T_camera.position_mm))
    assert [sample.region for sample in data] == data.labels.tolist()
    with pytest.raises(IndexError):
        data[12]


def edit_row(folder: Path, index: int, **changes: object) -> None:
    rows = [json.loads(row) for row in (folder / "samples.jsonl").read_text().splitlines()]
    rows[index].update(changes)
    (folder / "samples.jsonl").write_text("".join(json.dumps(row) + "\n" for row in rows))


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"anatomy_T_camera": None}, "a pose (a rigid 4×4 matrix) of sample 5 in set, got none"),
        ({"anatomy_T_camera": [[float("nan")] * 4] * 4}, "of sample 5 in set, got NaN or infinity"),
        ({"anatomy_T_camera": [[2, 0, 0, 0], [0, 2, 0, 0], [0, 0, 2, 0], [0, 0, 0, 1]]}, "rigid"),
        ({"anatomy_T_camera": [1, 2, 3]}, "got numbers of shape 3;"),
        ({"anatomy_T_camera": [[1, 0, 0, 0]] * 3}, "got numbers of shape 3×4;"),
        ({"anatomy_T_camera": [[1, 0, 0], [0, 1]]}, "got rows that are no four numbers each;"),
        ({"region": 4}, "a region 0…3 of sample 5"),
        ({"region": None}, "a region 0…3 of sample 5"),
        ({"trajectory": None}, "a whole number as trajectory of sample 5"),
        ({"position": 1.5}, "a whole number as position of sample 5"),
        ({"position": 10**30}, "a whole number as position of sample 5"),
        ({"anatomy_T_camera": [10**400] * 16}, "a pose (a rigid 4×4 matrix) of sample 5"),
        ({"image": "images/999.png"}, "the picture images/999.png of sample 5"),
        ({"image": "../../etc/hostname"}, "of sample 5"),
        ({"depth": None}, "the picture None of sample 5"),
    ],
)
def test_a_broken_row_is_told_by_number(broken, changes, said) -> None:
    edit_row(broken, 5, **changes)
    with pytest.raises(DatasetError) as caught:
        Dataset.open(broken)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)
    assert str(caught.value).count("expected") == str(caught.value).count(";") == 1


def test_a_missing_picture_is_told(broken) -> None:
    (broken / "images" / "000007.png").unlink()
    with pytest.raises(DatasetError, match=r"images/000007\.png of sample 7"):
        Dataset.open(broken)


def test_a_missing_row_is_told(broken) -> None:
    rows = (broken / "samples.jsonl").read_text().splitlines(keepends=True)
    (broken / "samples.jsonl").write_text("".join(rows[:-1]))
    with pytest.raises(DatasetError, match=r"expected 12 rows .* got 11"):
        Dataset.open(broken)


@pytest.mark.parametrize("content", ["", "{", "[]", '{"schema": "naris.dataset/9"}', '{"schema": "naris.dataset/1"}'])
def test_a_broken_record_is_told(broken, content) -> None:
    (broken / "dataset.json").write_text(content)
    with pytest.raises(DatasetError) as caught:
        Dataset.open(broken)
    assert "set" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("key", ["name", "digest", "frame"])
def test_an_anatomy_without_its_words_is_told(broken, key) -> None:
    about = json.loads((broken / "dataset.json").read_text())
    del about["anatomy"][key]
    (broken / "dataset.json").write_text(json.dumps(about))
    with pytest.raises(DatasetError, match=f"regions, anatomy, depth and intrinsics in dataset.json of set.*{key}"):
        Dataset.open(broken)


@pytest.mark.parametrize("content", [b'{"image": "\xff\xfe"}\n', b"[" * 100_000])
def test_rows_that_are_no_text_are_told(broken, content) -> None:
    (broken / "samples.jsonl").write_bytes(content)
    with pytest.raises(DatasetError, match=r"samples\.jsonl") as caught:
        Dataset.open(broken)
    assert "\n" not in str(caught.value)


def test_a_folder_that_is_none_is_told(tmp_path) -> None:
    with pytest.raises(DatasetError, match="check the path"):
        Dataset.open(tmp_path / "nowhere")


def test_a_text_file_named_png_is_told(broken) -> None:
    (broken / "images" / "000002.png").write_text("this is no picture")
    data = Dataset.open(broken)
    with pytest.raises(ImageError, match=r"000002\.png, got a file of another kind"):
        data.images()


def test_a_picture_of_another_size_is_told(broken) -> None:
    (broken / "images" / "000002.png").write_bytes(encode_rgb(np.zeros((30, 50, 3), np.uint8)))
    with pytest.raises(ImageError, match=r"40×40 pixels in 000002\.png, got 50×30"):
        Dataset.open(broken)[2]


def test_a_damaged_picture_is_told(broken) -> None:
    path = broken / "images" / "000002.png"
    path.write_bytes(path.read_bytes()[:60])
    with pytest.raises(ImageError, match=r"000002\.png"):
        read_rgb(path, 40, 40)
    with pytest.raises(ImageError, match="16-bit"):
        read_depth(broken / "images" / "000003.png", 40, 40)


def test_a_huge_picture_is_refused_before_it_is_decoded(tmp_path) -> None:
    data = bytearray(encode_rgb(np.zeros((4, 4, 3), np.uint8)))
    data[16:24] = (60000).to_bytes(4, "big") * 2
    (tmp_path / "bomb.png").write_bytes(data)
    with pytest.raises(ImageError, match="60000×60000"):
        read_rgb(tmp_path / "bomb.png", 4, 4)


@pytest.mark.parametrize("lens", [Pinhole(), Brown(0.1, -0.02, 1e-3, 2e-3, 0.01), Fisheye(0.1, 0.2, 0.3, 0.4)])
def test_intrinsics_come_back_from_json(lens) -> None:
    intrinsics = Intrinsics(64, 48, 50.5, 51.5, 30.25, 24.75, lens)
    assert intrinsics_from_json(json.loads(json.dumps(intrinsics_to_json(intrinsics)))) == intrinsics
    with pytest.raises(DatasetError, match="a lens of the kind"):
        intrinsics_from_json({**intrinsics_to_json(intrinsics), "lens": {"kind": "mirror"}})


def test_region_labels_come_back_from_json() -> None:
    labels = RegionLabels.of(SLABS)
    back = RegionLabels.from_json(json.loads(json.dumps(labels.to_json())))
    assert (back.name, back.names) == (labels.name, labels.names)
    assert np.array_equal(back.neighbours, labels.neighbours)


# --- the original's folders ----------------------------------------------------------------------------------------


def test_the_originals_folders_both_ways(made, tmp_path) -> None:
    data = Dataset.open(made)
    write_original(data, tmp_path / "old")
    back = read_original(tmp_path / "old", SLABS, data.intrinsics)
    assert np.array_equal(back.images(), data.images())
    assert np.array_equal(back.labels, data.labels)
    apart = np.linalg.norm(back.anatomy_T_camera.position_mm - data.anatomy_T_camera.position_mm, axis=1)
    assert apart.max() < 1e-6
    assert (back.anatomy_T_camera.forward * data.anatomy_T_camera.forward).sum(axis=1).min() > 1 - 1e-9
    again = tmp_path / "again"
    write_original(back, again)
    assert (again / "pose" / "03.txt").read_text() == (tmp_path / "old" / "pose" / "03.txt").read_text()
    assert (again / "frame" / "03.png").read_bytes() == data.image_files[3].read_bytes()


def original_folder(folder: Path, names: list[str]) -> Path:
    """Pictures whose grey value is their number, and poses whose y is."""
    (folder / "frame").mkdir(parents=True)
    (folder / "pose").mkdir()
    for i, name in enumerate(names):
        cv2.imwrite(str(folder / "frame" / f"{name}.png"), np.full((300, 300, 3), i, np.uint8))
        (folder / "pose" / f"{name}.txt").write_text(f"0.0 0.0\n{i - 35}.0 1.0\n0.0 0.0\n")
    return folder


def test_pictures_and_poses_are_paired_by_name(tmp_path) -> None:
    """Names whose listing order differs from folder to folder: every picture still has its own pose."""
    names = [f"training_{i:02d}_{i % 3}_{j}" for i in range(8) for j in (6, 10)]
    paper = SlabRegions("paper", ("a", "b", "c", "d"), "mean", 1, (-30.0, -15.0, 0.0))
    data = read_original(original_folder(tmp_path, names), paper)
    assert [path.stem for path in data.image_files] == names
    assert (data.images()[:, 0, 0, 0] - 35.0 == data.anatomy_T_camera.position_mm[:, 1]).all()
    assert data.anatomy_T_camera.target == "mean"
    assert (data.labels == (data.images()[:, 0, 0, 0] - 35.0 > -30)).all()


def test_widows_of_either_kind_are_told_by_name(tmp_path) -> None:
    folder = original_folder(tmp_path, ["00", "01", "02"])
    (folder / "pose" / "01.txt").unlink()
    with pytest.raises(DatasetError, match=r"a pose of the same name .* none for frame/01\.png"):
        read_original(folder, SLABS)
    (folder / "frame" / "01.png").unlink()
    (folder / "frame" / "02.png").unlink()
    with pytest.raises(DatasetError, match=r"a picture of the same name .* none for pose/02\.txt"):
        read_original(folder, SLABS)


def test_a_broken_pose_or_folder_is_told(tmp_path) -> None:
    folder = original_folder(tmp_path / "set", ["00", "01"])
    (folder / "pose" / "01.txt").write_text("nan 0\n0 1\n0 0\n")
    with pytest.raises(DatasetError, match=r"01\.txt"):
        read_original(folder, SLABS)
    with pytest.raises(DatasetError, match="frame/"):
        read_original(tmp_path, SLABS)
    (tmp_path / "empty" / "frame").mkdir(parents=True)
    (tmp_path / "empty" / "pose").mkdir()
    with pytest.raises(DatasetError, match="pictures in frame/"):
        read_original(tmp_path / "empty", SLABS)
