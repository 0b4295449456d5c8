"""Files: what other programs read of ours, by their own readers, and what we read of theirs."""

import io
import json
from dataclasses import replace

import numpy as np
import pytest
import SimpleITK as sitk
from PIL import Image

from naris.core.pose import CAMERA, Pose
from naris.errors import InputError, MachineError, NarisError
from naris.register.files import (
    DEVIATIONS,
    has_normals,
    read_cloud,
    read_depth_image,
    read_normals,
    slicer_landmarks,
    slicer_transform,
    write_slicer_hdf5,
)

POSE = Pose.exp(np.array([10.0, -20.0, 30.0, 0.3, -0.8, 1.1]), "LPS", CAMERA)


def test_itk_reads_the_transform_as_the_way_from_the_world_to_the_camera(tmp_path):
    file = tmp_path / "a.tfm"
    file.write_text(slicer_transform(POSE))
    read = sitk.ReadTransform(str(file))
    for point in np.random.default_rng(0).uniform(-9, 9, (5, 3)):
        np.testing.assert_allclose(read.TransformPoint(POSE.apply(point).tolist()), point, atol=1e-9)
    np.testing.assert_allclose(read.GetInverse().TransformPoint((0.0, 0.0, 0.0)), POSE.position_mm, atol=1e-9)


def test_text_and_hdf5_are_one_transform(tmp_path):
    (tmp_path / "a.tfm").write_text(slicer_transform(POSE))
    write_slicer_hdf5(POSE, tmp_path / "a.h5")
    text, hdf5 = (sitk.ReadTransform(str(tmp_path / name)) for name in ("a.tfm", "a.h5"))
    assert text.GetName() == hdf5.GetName() == "AffineTransform"
    for point in np.random.default_rng(0).uniform(-90, 90, (9, 3)).tolist():
        np.testing.assert_allclose(hdf5.TransformPoint(point), text.TransformPoint(point), atol=1e-12)
    assert [one.name for one in tmp_path.glob("*.h5")] == ["a.h5"]


def test_no_transform_is_made_of_another_frame(tmp_path):
    other = Pose(POSE.matrix, "mean", CAMERA)
    with pytest.raises(InputError, match="an anatomy in LPS"):
        slicer_transform(other)
    with pytest.raises(InputError, match="an anatomy in LPS"):
        write_slicer_hdf5(other, tmp_path / "a.h5")
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_written_as_hdf5_is_said(tmp_path, monkeypatch):
    def full(*_):
        raise RuntimeError("H5Fcreate failed")

    monkeypatch.setattr(sitk, "WriteTransform", full)
    with pytest.raises(MachineError, match="an error of the HDF5 library"):
        write_slicer_hdf5(POSE, tmp_path / "a.h5")
    assert not list(tmp_path.iterdir())


def test_the_markups_say_their_frame_and_where_the_camera_is(nose):
    told = json.loads(json.dumps(slicer_landmarks(nose, POSE)))["markups"][0]
    assert told["coordinateSystem"] == "LPS"
    points = {one["label"]: one["position"] for one in told["controlPoints"]}
    assert set(nose.landmarks_mm) < set(points)
    np.testing.assert_allclose(points["camera"], POSE.position_mm)
    ahead = np.array(points["10 mm ahead of the camera"]) - POSE.position_mm
    np.testing.assert_allclose(ahead, 10 * POSE.forward)


@pytest.mark.parametrize("suffix", [".npy", ".txt", ".csv", ".ply"])
def test_normals_stand_behind_the_points(tmp_path, suffix):
    numbers = np.random.default_rng(2).uniform(-5, 5, (20, 6))
    numbers[:, 3:] /= np.linalg.norm(numbers[:, 3:], axis=1, keepdims=True)
    file = tmp_path / f"cloud{suffix}"
    if suffix == ".npy":
        np.save(file, numbers)
    elif suffix == ".ply":
        names = "".join(f"property double {name}\n" for name in ("nx", "x", "y", "z", "ny", "nz"))
        rows = "\n".join(" ".join(map(repr, row)) for row in numbers[:, [3, 0, 1, 2, 4, 5]].tolist())
        file.write_text(f"ply\nformat ascii 1.0\nelement vertex 20\n{names}end_header\n{rows}\n")
    else:
        np.savetxt(file, numbers, delimiter="," if suffix == ".csv" else " ")
    np.testing.assert_allclose(read_cloud(file), numbers[:, :3])
    np.testing.assert_allclose(read_normals(file), numbers[:, 3:])
    assert has_normals(file)


def test_clouds_without_normals_are_refused_where_they_are_asked_for(tmp_path):
    file = tmp_path / "cloud.txt"
    file.write_text("1 2 3\n4 5 6\n")
    with pytest.raises(InputError, match="the normal"):
        read_normals(file)
    assert not has_normals(file)
    with pytest.raises(InputError, match="no such file"):
        has_normals(tmp_path / "missing.txt")


def test_colours_are_no_normals(tmp_path):
    file = tmp_path / "cloud.txt"
    file.write_text("1 2 3 255 0 10\n4 5 6 250 2 8\n")
    assert not has_normals(file)
    assert len(read_cloud(file)) == 2


@pytest.mark.parametrize("suffix", [".npy", ".txt", ".csv", ".xyz", ".ply"])
def test_a_cloud_is_read_from_any_of_its_formats(tmp_path, suffix):
    points = np.random.default_rng(1).uniform(-5, 5, (20, 3)).round(3)
    file = tmp_path / f"cloud{suffix}"
    if suffix == ".npy":
        np.save(file, points)
    elif suffix == ".ply":
        rows = "\n".join(" ".join(map(str, row)) for row in points)
        head = "ply\nformat ascii 1.0\nelement vertex 20\nproperty double x\nproperty double y\nproperty double z\n"
        file.write_text(f"{head}end_header\n{rows}\n")
    else:
        separator = "," if suffix == ".csv" else " "
        file.write_text("x y z\n" + "\n".join(separator.join(map(str, row)) for row in points))
    np.testing.assert_allclose(read_cloud(file), points, atol=1e-6)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("a.txt", b"1 2 3\n4 five 6\n"),
        ("a.csv", b"1,5 2,5 -3,5\n-4,25 5,0 6,75\n"),
        ("a.npy", b"\x93NUMPY"),
        ("a.ply", b"ply\n"),
        ("a.obj", b""),
        ("a.xyz", b"\xff\xfe"),
    ],
)
def test_what_is_no_cloud_is_refused_in_a_sentence(tmp_path, name, content):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(NarisError, match="expected"):
        read_cloud(tmp_path / name)
    with pytest.raises(InputError, match="no such file"):
        read_cloud(tmp_path / "missing.txt")


def test_depth_is_read_in_its_unit(tmp_path):
    steps = np.random.default_rng(2).integers(0, 4000, (20, 30)).astype(np.uint16)
    Image.fromarray(steps).save(tmp_path / "d.png")
    np.save(tmp_path / "d.npy", steps.astype(np.float32) / 200)
    np.testing.assert_allclose(read_depth_image(tmp_path / "d.png", 0.005), steps / 200, atol=1e-9)
    np.testing.assert_allclose(read_depth_image(tmp_path / "d.npy", 1.0), steps / 200, atol=1e-5)


def test_pictures_that_hold_no_depth_are_refused(tmp_path):
    Image.fromarray(np.full((20, 30, 3), 90, np.uint8)).save(tmp_path / "rgb.png")
    with pytest.raises(InputError, match="16 bits"):
        read_depth_image(tmp_path / "rgb.png", 1.0)
    (tmp_path / "bad.png").write_bytes(b"\x89PNG\r\n")
    with pytest.raises(InputError, match="damaged"):
        read_depth_image(tmp_path / "bad.png", 1.0)
    np.save(tmp_path / "empty.npy", np.zeros((4, 4)))
    with pytest.raises(InputError, match="depth above 0"):
        read_depth_image(tmp_path / "empty.npy", 1.0)
    with pytest.raises(InputError, match=f"{DEVIATIONS} above 0"):
        read_depth_image(tmp_path / "empty.npy", 1.0, DEVIATIONS)
    np.save(tmp_path / "cube.npy", np.ones((4, 4, 4)))
    with pytest.raises(InputError, match="one channel"):
        read_depth_image(tmp_path / "cube.npy", 1.0)


def _archive() -> bytes:
    content = io.BytesIO()
    np.savez(content, points=np.ones((20, 3)))
    return content.getvalue()


def _with_header(header: str) -> bytes:
    text = header.ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()


@pytest.mark.parametrize("read", [read_cloud, lambda path: read_depth_image(path, 1.0)])
@pytest.mark.parametrize(
    "content",
    [
        _archive(),
        b"PK\x03\x04 and no archive",
        b"",
        _with_header("{'descr': '<f8', 'fortran_order': False, 'shape': (3"),
        _with_header("{'descr': (), 'fortran_order': False, 'shape': (3, 3), }"),
        _with_header("{[]: 1}"),
        _with_header("{'descr': '<f8', 'fortran_order': False, 'shape': (" + "1" + "0" * 30 + ", 3), }"),
        _with_header("{'descr': '<f8', 'fortran_order': False, 'shape': (1000000000000, 3), }"),
    ],
)
def test_what_is_no_array_of_numpy_is_one_sentence(tmp_path, read, content):
    (tmp_path / "d.npy").write_bytes(content)
    with pytest.raises(InputError, match="numpy array in"):
        read(tmp_path / "d.npy")


@pytest.mark.parametrize("kind", ["complex128", "timedelta64[s]", "bool"])
def test_what_is_no_number_is_no_depth_and_no_point(tmp_path, kind):
    np.save(tmp_path / "d.npy", np.ones((20, 3)).astype(kind))
    with pytest.raises(InputError, match="points"):
        read_cloud(tmp_path / "d.npy")
    with pytest.raises(InputError, match="one channel"):
        read_depth_image(tmp_path / "d.npy", 1.0)


def test_a_byte_order_mark_is_no_number(tmp_path):
    (tmp_path / "points.txt").write_text("1 2 3\n4 5 6\n", encoding="utf-8-sig")
    np.testing.assert_array_equal(read_cloud(tmp_path / "points.txt"), [[1, 2, 3], [4, 5, 6]])


def test_depth_of_the_other_sign_is_told(tmp_path):
    depth = np.ones((20, 30))
    depth[:, :6] = -1
    np.save(tmp_path / "d.npy", depth)
    with pytest.raises(InputError, match=r"120 of 600 below it.*which way its z looks"):
        read_depth_image(tmp_path / "d.npy", 1.0)
    depth[:, 2:] = 1
    np.save(tmp_path / "d.npy", depth)
    assert (read_depth_image(tmp_path / "d.npy", 1.0) > 0).mean() == 28 / 30


def test_markups_of_another_frame_are_none(nose):
    with pytest.raises(InputError, match="one in mean"):
        slicer_landmarks(replace(nose, frame="mean", regions={}, passages=()), None)
