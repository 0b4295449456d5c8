"""The published format: on the real shot its poses are proven by the pictures, and what is broken is refused."""

import re

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from scipy.spatial.transform import Rotation

from naris.core.pose import Pose
from naris.errors import InputError, NarisError
from naris.register.sfm.published import read_published
from naris.register.sfm.read import read_reconstruction
from tests.conftest import shared_file

PATCH = 25
EVERY = 5


@pytest.fixture(scope="module")
def shot():
    return shared_file("sinus-sfm")


@pytest.fixture(scope="module")
def read(shot):
    return read_reconstruction(shot)


def test_all_of_the_real_shot_is_read(read):
    assert len(read.views) == 35 and read.points.shape == (570, 3)
    assert read.views[0].name == "4584" and read.views[-1].name == "4618"
    assert sum(len(view.seen) for view in read.views) == 6585
    camera = read.views[0].intrinsics
    assert (camera.width, camera.height, camera.fx, camera.cx) == (1920, 1080, 677.171, 872.127)


def test_every_point_falls_into_each_picture_that_saw_it(shot, read):
    valid = cv2.imread(str(shot / "undistorted_mask.jpg"), cv2.IMREAD_GRAYSCALE) > 127
    in_mask = []
    for view in read.views:
        inside = read.seen_by(view)
        assert inside[:, 2].min() > 1.0
        pixels, in_picture = view.intrinsics.project(inside)
        assert in_picture.all(), view.name
        column, row = np.rint(pixels).astype(int).T
        in_mask.append(valid[row, column])
    assert np.concatenate(in_mask).mean() > 0.94  # the rest lies within a few pixels of its edge, or in the wider frame


def test_the_pictures_of_a_point_are_alike_and_of_the_inverse_poses_are_not(shot, read):
    """Most points would also fall into the pictures with the poses the other way round: only the pixels tell."""
    pictures = [_picture(shot, view.name) for view in read.views[::EVERY]]
    right = _alike(read, pictures, [view.camera_T_world for view in read.views[::EVERY]])
    inverse = [Pose(view.camera_T_world.inverse().matrix, "camera", "world") for view in read.views[::EVERY]]
    wrong = _alike(read, pictures, inverse)
    assert np.median(right) > 0.85 and (right > 0.8).mean() > 0.6
    assert np.median(wrong) < 0.6 and (wrong > 0.8).mean() < 0.25


def _picture(shot, name):
    grey = cv2.imread(str(shot / f"{int(name):08d}.jpg"), cv2.IMREAD_GRAYSCALE)
    return cv2.GaussianBlur(grey, (0, 0), 1.5).astype(np.float32)


def _alike(read, pictures, camera_T_world):
    """Correlations of the surroundings of each point in one picture and the next that saw it."""
    found, before = [], {}
    for view, picture, pose in zip(read.views[::EVERY], pictures, camera_T_world, strict=True):
        pixels, _ = view.intrinsics.project(pose.apply(read.points[view.seen]))
        for point, pixel in zip(view.seen.tolist(), pixels, strict=True):
            if not (PATCH < pixel[0] < view.intrinsics.width - PATCH and PATCH < pixel[1] < 1080 - PATCH):
                continue
            patch = cv2.getRectSubPix(picture, (PATCH, PATCH), pixel.tolist()).ravel()
            if patch.std() > 0 and point in before:
                found.append(np.corrcoef(before[point], patch)[0, 1])
            if patch.std() > 0:
                before[point] = patch
    return np.array(found)


@st.composite
def reconstructions(draw):
    """Some poses, points, and who saw what."""
    numbers = draw(st.lists(st.integers(0, 99999), min_size=1, max_size=4, unique=True))
    seed = draw(st.integers(0, 2**32 - 1))
    rng = np.random.default_rng(seed)
    count = draw(st.integers(1, 6))
    seen = [draw(st.lists(st.sampled_from(numbers), min_size=1, unique=True)) for _ in range(count)]
    return (
        numbers,
        rng.normal(size=(len(numbers), 3)),
        Rotation.random(len(numbers), rng),
        rng.normal(size=(count, 3)),
        seen,
    )


def written(folder, numbers, positions, turns, points, seen):
    text = "header: \n  seq: 0\n  stamp: 0.000000000\n  frame_id: \nposes[]:\n"
    for i, (xyz, q) in enumerate(zip(positions.tolist(), turns.as_quat().tolist(), strict=True)):
        place = "".join(f"      {axis}: {value!r}\n" for axis, value in zip("xyz", xyz, strict=True))
        turn = "".join(f"      {axis}: {value!r}\n" for axis, value in zip("xyzw", q, strict=True))
        text += f"  poses[{i}]: \n    position: \n{place}    orientation: \n{turn}"
    (folder / "motion.yaml").write_text(text)
    head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    head += "".join(f"property double {axis}\n" for axis in "xyz") + "end_header\n"
    (folder / "structure.ply").write_text(head + "".join(" ".join(map(repr, row)) + "\n" for row in points.tolist()))
    (folder / "visible_view_indexes").write_text("".join(f"{number}\n" for number in numbers))
    sightings = "".join("-1\n" + "".join(f"{number}\n" for number in of) for of in seen)
    (folder / "view_indexes_per_point").write_text(sightings)
    (folder / "camera_intrinsics_per_view").write_text("70.0\n71.0\n48.0\n40.0\n")
    Image.new("L", (96, 80), 255).save(folder / "undistorted_mask.png")
    return folder


@given(reconstructions())
@settings(max_examples=40)
def test_what_was_written_is_read(tmp_path_factory, made):
    numbers, positions, turns, points, seen = made
    read = read_published(written(tmp_path_factory.mktemp("made"), *made))
    np.testing.assert_array_equal(read.points, points)
    for i, view in enumerate(read.views):
        assert view.name == str(numbers[i])
        np.testing.assert_allclose(view.camera_T_world.inverse().position_mm, positions[i], atol=1e-12)
        np.testing.assert_allclose(view.camera_T_world.inverse().rotation, turns[i].as_matrix(), atol=1e-12)
        assert view.seen.tolist() == [at for at, of in enumerate(seen) if numbers[i] in of]
        assert (view.intrinsics.width, view.intrinsics.height, view.intrinsics.fy) == (96, 80, 71.0)


def plain(folder):
    rng = np.random.default_rng(0)
    return written(
        folder, [5, 6], rng.normal(size=(2, 3)), Rotation.random(2, rng), rng.normal(size=(2, 3)), [[5], [5, 6]]
    )


@pytest.mark.parametrize(
    ("name", "change", "message"),
    [
        ("motion.yaml", lambda text: text.replace("w: ", "w: nan  "), "poses with position|finite number in line"),
        ("motion.yaml", lambda text: text[: len(text) // 2], "poses with position and orientation"),
        ("motion.yaml", lambda text: "poses[]:\n", "got none"),
        ("motion.yaml", lambda text: re.sub("w: .*", "w: 9.0", text), "quaternions of length 1"),
        ("structure.ply", lambda text: text[:-30], "stops before the last"),
        ("visible_view_indexes", lambda text: "5\n", "2 for 1"),
        ("visible_view_indexes", lambda text: "5\n5\n", "a pose in motion.yaml for each number"),
        ("visible_view_indexes", lambda text: "5\n6.5\n", "whole numbers"),
        ("view_indexes_per_point", lambda text: text.replace("6", "7"), "got 7"),
        ("view_indexes_per_point", lambda text: "-1\n5\n", "2 points in view_indexes_per_point, got 1 times"),
        ("view_indexes_per_point", lambda text: "", "numbers in view_indexes_per_point"),
        ("camera_intrinsics_per_view", lambda text: "1\n2\n3\n", "got 3 numbers"),
        ("camera_intrinsics_per_view", lambda text: "1\n2\nx\n4\n", "'x'"),
    ],
)
def test_what_is_broken_is_one_sentence(tmp_path, name, change, message):
    file = plain(tmp_path) / name
    file.write_text(change(file.read_text()))
    with pytest.raises(NarisError, match=message):
        read_published(tmp_path)


@pytest.mark.parametrize(
    "name",
    ["motion.yaml", "structure.ply", "visible_view_indexes", "view_indexes_per_point", "camera_intrinsics_per_view"],
)
def test_each_file_is_missed(tmp_path, name):
    (plain(tmp_path) / name).unlink()
    with pytest.raises(InputError, match=f"{name}, got no such file"):
        read_published(tmp_path)


def test_the_size_of_the_pictures_is_needed(tmp_path):
    (plain(tmp_path) / "undistorted_mask.png").unlink()
    with pytest.raises(InputError, match="it tells the pictures' size"):
        read_published(tmp_path)
    (plain(tmp_path) / "cameras.txt").write_text("")
    with pytest.raises(InputError, match="got both"):
        read_reconstruction(tmp_path)
