"""COLMAP's files: text and binary tell the same, in its own conventions, and what is broken is refused."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from naris.errors import InputError
from naris.register.sfm.colmap import read_colmap
from naris.register.sfm.read import read_reconstruction
from tests.register.sfm.colmap_models import MODELS, Model, write_binary, write_text

LENSES = {
    "SIMPLE_PINHOLE": [70.0, 48.0, 40.0],
    "PINHOLE": [70.0, 72.0, 48.0, 40.0],
    "SIMPLE_RADIAL": [70.0, 48.0, 40.0, -0.1],
    "RADIAL": [70.0, 48.0, 40.0, -0.1, 0.02],
    "OPENCV": [70.0, 72.0, 48.0, 40.0, -0.1, 0.02, 0.003, -0.002],
    "OPENCV_FISHEYE": [70.0, 72.0, 48.0, 40.0, -0.1, 0.02, 0.003, -0.002],
    "SIMPLE_RADIAL_FISHEYE": [70.0, 48.0, 40.0, -0.1],
    "RADIAL_FISHEYE": [70.0, 48.0, 40.0, -0.1, 0.02],
}
numbers = st.floats(-1e6, 1e6)
names = st.text("abcxyzäß059._-/", min_size=1, max_size=12)


@st.composite
def models(draw):
    """Any model that COLMAP might write; two words in a name, images without features, features without points."""
    cameras = draw(st.dictionaries(st.integers(1, 2**31), st.sampled_from(sorted(LENSES)), min_size=1, max_size=3))
    points = draw(st.dictionaries(st.integers(0, 2**40), st.tuples(numbers, numbers, numbers), min_size=1, max_size=9))
    feature = st.tuples(numbers, numbers, st.sampled_from([-1, *points]))
    images = []
    for number, name in enumerate(draw(st.lists(names, min_size=1, max_size=4, unique=True)), 5):
        turn = np.array(draw(st.tuples(*[st.floats(-1, 1)] * 3)) + (draw(st.floats(0.1, 1)),))
        q, t = (turn / np.linalg.norm(turn)).tolist(), list(draw(st.tuples(numbers, numbers, numbers)))
        camera, features = draw(st.sampled_from(sorted(cameras))), draw(st.lists(feature, max_size=6))
        images.append((number, q, t, camera, f"shot {name}", features))
    rows = [(number, model, 96, 80, LENSES[model]) for number, model in cameras.items()]
    return Model(rows, images, [(number, list(xyz)) for number, xyz in points.items()])


@given(models())
def test_text_and_binary_tell_the_same(tmp_path_factory, model):
    folder = tmp_path_factory.mktemp("model")
    text, binary = read_colmap(write_text(model, folder / "t")), read_colmap(write_binary(model, folder / "b"))
    np.testing.assert_array_equal(text.points, binary.points)
    np.testing.assert_array_equal(text.points, [xyz for _, xyz in model.points])
    order = [number for number, _ in model.points]
    for one, other, (_, _, t, _, name, features) in zip(text.views, binary.views, model.images, strict=True):
        assert one.name == other.name == name
        assert one.intrinsics == other.intrinsics
        np.testing.assert_array_equal(one.camera_T_world.matrix, other.camera_T_world.matrix)
        np.testing.assert_array_equal(one.camera_T_world.position_mm, t)
        np.testing.assert_array_equal(one.seen, other.seen)
        assert {order[at] for at in one.seen} == {point for *_, point in features} - {-1}


@given(models(), st.data())
def test_a_file_that_was_cut_anywhere_is_refused(tmp_path_factory, model, data):
    folder = write_binary(model, tmp_path_factory.mktemp("cut"))
    file = folder / data.draw(st.sampled_from(["cameras.bin", "images.bin", "points3D.bin"]))
    whole = file.read_bytes()
    file.write_bytes(whole[: data.draw(st.integers(0, len(whole) - 1))])
    with pytest.raises(InputError, match=f"expected a whole model in {file.name}, got a file that ends at byte"):
        read_colmap(folder)
    file.write_bytes(whole + b"\0")
    with pytest.raises(InputError, match="1 more bytes"):
        read_colmap(folder)


@pytest.mark.parametrize("model", sorted(LENSES))
def test_lenses_bend_as_in_opencv_with_pixels_counted_from_their_middles(tmp_path, model):
    camera = read_colmap(write_text(small(model), tmp_path)).views[0].intrinsics
    points = np.random.default_rng(0).uniform([-3, -3, 4], [3, 3, 9], (40, 3))
    p = LENSES[model]
    focal, centre, rest = (p[:2], p[2:4], p[4:]) if model in ("PINHOLE", "OPENCV", "OPENCV_FISHEYE") else (
        [p[0]] * 2, p[1:3], p[3:]
    )  # fmt: skip
    k = np.array([[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1]])
    bent, none = np.zeros(4), np.zeros(3)
    bent[: len(rest)] = rest
    project = cv2.fisheye.projectPoints if "FISHEYE" in model else cv2.projectPoints
    shaped = points[:, None] if "FISHEYE" in model else points
    expected = project(shaped, none, none, k, bent)[0].reshape(-1, 2)
    np.testing.assert_allclose(camera.project(points)[0] + 0.5, expected, atol=1e-6)


def small(model="PINHOLE"):
    features = [(1.0, 2.0, 7), (3.0, 4.0, 9), (5.0, 6.0, -1)]
    parameters = LENSES.get(model, [1.0] * 12 if model == "FULL_OPENCV" else [1.0] * 5)
    images = [(1, [1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 5.0], 3, "a.png", features)]
    return Model([(3, model, 96, 80, parameters)], images, [(7, [0.0, 1.0, 2.0]), (9, [1.0, 0.0, 2.0])])


def test_points_of_a_view_lie_in_its_camera(tmp_path):
    read = read_reconstruction(write_binary(small(), tmp_path))
    np.testing.assert_allclose(read.seen_by(read.view("a.png")), [[0, 1, 7], [1, 0, 7]])
    with pytest.raises(InputError, match=r"a view of the reconstruction \(a.png\), got 'b.png'"):
        read.view("b.png")


@pytest.mark.parametrize("write", [write_text, write_binary])
@pytest.mark.parametrize("model", ["FULL_OPENCV", "FOV"])
def test_other_cameras_are_refused_by_name(tmp_path, write, model):
    assert model in MODELS
    with pytest.raises(InputError, match=f"got {model}; undistort"):
        read_colmap(write(small(model), tmp_path))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"points": [(7, [0.0, float("nan"), 2.0]), (9, [1.0, 0.0, 2.0])]}, "finite numbers in points3D"),
        ({"points": [(7, [0.0, 1.0, 2.0])]}, "1 of 2 missing"),
        ({"points": [(7, [0.0, 1.0, 2.0]), (9, [1.0, 0.0, 2.0]), (9, [1.0, 0.0, 2.0])]}, "points of different numbers"),
        ({"images": [], "points": [(1, [0.0, 0.0, 1.0])]}, "no images"),
        ({"images": [(1, [1.0, 0, 0, 0], [0.0, 0, 0], 3, "a", [])], "points": []}, "no points"),
        ({"images": [(1, [1.0, 0, 0, 0], [0.0, 0, 0], 4, "a", [])]}, "camera 4 of the image a"),
        ({"images": [(1, [1.0, 1, 0, 0], [0.0, 0, 0], 3, "a", [])]}, "a quaternion of length 1"),
        ({"images": [(1, [1.0, 0, 0, 0], [float("inf"), 0, 0], 3, "a", [])]}, "finite numbers in the pose of a"),
        ({"images": [(i, [1.0, 0, 0, 0], [0.0, 0, 0], 3, "a", []) for i in (1, 2)]}, "images of different names"),
        ({"cameras": [(3, "PINHOLE", 96, 80, [float("nan")] * 4)]}, "finite numbers in camera 3"),
        ({"cameras": [(3, "PINHOLE", 0, 80, [1.0] * 4)]}, "positive sizes"),
    ],
)
@pytest.mark.parametrize("write", [write_text, write_binary])
def test_models_that_contradict_themselves_are_refused(tmp_path, write, changes, message):
    plain = small()
    rows = {"cameras": plain.cameras, "images": plain.images, "points": plain.points} | changes
    with pytest.raises(InputError, match=message):
        read_colmap(write(Model(**rows), tmp_path))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("cameras.txt", "1 PINHOLE 96\n", r"in line 1 in cameras\.txt"),
        ("cameras.txt", "3 PINHOLE 96 80 1 2 3\n", "4 parameters of camera 3"),
        ("images.txt", "1 1 0 0 0 0 0 5 3 a.png\n1 2\n", "a pose, a camera and a name"),
        ("images.txt", "1 1 0 0 0 0 0 five 3 a.png\n\n", "five"),
        ("points3D.txt", "# none\n7 1 2\n", "in line 2"),
        ("points3D.txt", b"\xff\xfe", "other bytes"),
    ],
)
def test_lines_that_say_something_else_are_named(tmp_path, name, content, message):
    write_text(small(), tmp_path)
    (tmp_path / name).write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(InputError, match=message):
        read_colmap(tmp_path)


def test_folders_that_are_not_one_whole_model_are_refused(tmp_path):
    with pytest.raises(InputError, match="got neither"):
        read_reconstruction(tmp_path)
    write_text(small(), tmp_path)
    (tmp_path / "images.txt").unlink()
    with pytest.raises(InputError, match=r"got cameras.txt, points3D.txt only"):
        read_reconstruction(tmp_path)
    write_binary(small(), tmp_path)
    (tmp_path / "cameras.bin").unlink()
    with pytest.raises(InputError, match=r"all as \.txt or all as \.bin"):
        read_reconstruction(tmp_path)
    write_binary(small(), write_text(small(), tmp_path))
    with pytest.raises(InputError, match="both, which may differ"):
        read_reconstruction(tmp_path)


def test_a_binary_file_of_an_unknown_camera_or_name_is_refused(tmp_path):
    write_binary(small(), tmp_path)
    cameras = (tmp_path / "cameras.bin").read_bytes()
    (tmp_path / "cameras.bin").write_bytes(cameras[:12] + b"\x63" + cameras[13:])
    with pytest.raises(InputError, match=r"a camera model from 0 to 10 in cameras\.bin, got 99"):
        read_colmap(tmp_path)
    (tmp_path / "cameras.bin").write_bytes(cameras)
    images = (tmp_path / "images.bin").read_bytes()
    (tmp_path / "images.bin").write_bytes(images.replace(b"a.png", b"\xff.png"))
    with pytest.raises(InputError, match="names in UTF-8"):
        read_colmap(tmp_path)


def test_poses_the_wrong_way_round_are_noticed(tmp_path):
    plain = small()
    turned = [(1, plain.images[0][1], [0.0, 0.0, -5.0], 3, "a.png", plain.images[0][5])]
    read = read_colmap(write_text(Model(plain.cameras, turned, plain.points), tmp_path))
    with pytest.raises(InputError, match=r"in front of the camera of a.png, got 2 of 2 behind it"):
        read.seen_by(read.view("a.png"))
