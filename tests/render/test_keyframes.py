"""Keyframe files both ways, their errors, and the way between keyframes."""

from __future__ import annotations

import itertools
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from naris.core.anatomy import Anatomy
from naris.core.pose import Pose, distance
from naris.errors import KeyframeError
from naris.render.keyframes import (
    Keyframes,
    check_belongs,
    interpolate,
    original_pose_text,
    read_keyframes,
    read_original_keyframes,
    write_keyframes,
    write_original_keyframes,
)


def tetrahedron(frame: str = "mean", size_mm: float = 10.0) -> Anatomy:
    vertices = size_mm * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], float)
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]], np.int32)
    return Anatomy(vertices, faces, frame, "a tetrahedron", "made up")


def random_poses(n: int, seed: int, roll: bool = True) -> Pose:
    rng = np.random.default_rng(seed)
    turn = rng.normal(0, 1, n) if roll else 0.0
    return Pose.look(rng.normal(0, 20, (n, 3)), rng.normal(0, 1, (n, 3)), np.array([0, 0, 1.0]), "mean", turn)


@settings(max_examples=30)
@given(st.integers(1, 12), st.integers(0, 2**32 - 1))
def test_json_gives_back_the_very_bits(tmp_path_factory, n, seed) -> None:
    path = tmp_path_factory.mktemp("k") / "keys.json"
    anatomy = tetrahedron()
    keyframes = Keyframes.of(random_poses(n, seed), anatomy)
    write_keyframes(keyframes, path)
    back = read_keyframes(path, anatomy)
    assert np.array_equal(back.anatomy_T_camera.matrix, keyframes.anatomy_T_camera.matrix)
    assert [k.name for k in back.keyframes] == [k.name for k in keyframes.keyframes]
    assert (back.anatomy_name, back.anatomy_digest, back.frame) == ("a tetrahedron", anatomy.digest, "mean")


def test_the_original_text_gives_back_upright_poses_in_natural_order(tmp_path) -> None:
    poses = random_poses(12, 3, roll=False)
    keyframes = Keyframes.of(poses, names=[str(i) for i in range(12)])
    write_original_keyframes(keyframes, tmp_path)
    back = read_original_keyframes(tmp_path, "mean")
    assert [k.name for k in back.keyframes] == [str(i) for i in range(12)]
    apart_mm, apart_rad = distance(poses, back.anatomy_T_camera)
    assert apart_mm.max() < 2e-6
    assert apart_rad.max() < 1e-5


def test_the_text_is_that_of_the_original() -> None:
    """numpy's `savetxt(zip(position, forward), fmt="%f %f")`, for the pose at which the original starts."""
    start = Pose.look(np.array([0, -35.0, 0]), np.array([0, 1.0, 0]), np.array([0, 0, 1.0]), "mean")
    assert original_pose_text(start) == "0.000000 0.000000\n-35.000000 1.000000\n0.000000 0.000000\n"


def test_the_way_is_that_of_the_original(tmp_path) -> None:
    """Against the original's shell script and `collect_data.py`, spelt out: `seq 0 dist`, p + j·unit, q's direction."""
    keyframes = Keyframes.of(random_poses(5, 8, roll=False))
    write_original_keyframes(keyframes, tmp_path)
    expected = []
    tables = [np.loadtxt(tmp_path / f"{i:02d}.txt") for i in range(5)]
    for previous, following in itertools.pairwise(tables):
        way = following[:, 0] - previous[:, 0]
        j = 0
        while j <= np.linalg.norm(way):
            expected.append((previous[:, 0] + j * way / np.linalg.norm(way), following[:, 1]))
            j += 1
    track = interpolate(read_original_keyframes(tmp_path, "mean"))
    assert len(track) == len(expected) > 20
    np.testing.assert_allclose(track.positions_mm, [p for p, _ in expected], atol=1e-9)
    unit = np.array([d / np.linalg.norm(d) for _, d in expected])
    np.testing.assert_allclose(track.directions, unit, atol=1e-9)
    assert (track.ups == [0, 0, 1]).all()


@given(st.floats(0.2, 5), st.integers(0, 1000))
def test_steps_are_even_and_never_pass_the_next_keyframe(step_mm, seed) -> None:
    poses = random_poses(4, seed)
    track = interpolate(Keyframes.of(poses), step_mm)
    for i in range(3):
        part = track.positions_mm[track.segments == i]
        start, end = poses.position_mm[i : i + 2]
        np.testing.assert_allclose(part[0], start, atol=1e-12)
        np.testing.assert_allclose(np.linalg.norm(np.diff(part, axis=0), axis=1), step_mm, rtol=1e-9)
        rest_mm = np.linalg.norm(end - part[-1])
        assert rest_mm < step_mm + 1e-9
        assert np.linalg.norm(part[-1] - start) <= np.linalg.norm(end - start) + 1e-9


def test_a_rolled_keyframe_keeps_its_roll_along_the_way() -> None:
    poses = random_poses(3, 1, roll=True)
    track = interpolate(Keyframes.of(poses))
    on_second = track.anatomy_T_camera[track.segments == 1]
    goal = Pose(np.repeat(poses.matrix[2:], len(on_second), axis=0), "mean", "camera")
    _, apart_rad = distance(on_second, goal)
    assert apart_rad.max() < 1e-6


def test_keyframes_in_one_place_give_one_position() -> None:
    pose = random_poses(1, 1).matrix
    track = interpolate(Keyframes.of(Pose(np.concatenate([pose, pose]), "mean", "camera")))
    assert len(track) == 1


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("no json", "expected JSON in keys.json"),
        ("[]", "schema naris.keyframes/1"),
        ('{"schema": "other/3"}', "'other/3'"),
        ('{"schema": "naris.keyframes/1", "frame": "mean"}', "`keyframes`"),
        ('{"schema": "naris.keyframes/1", "frame": "mean", "keyframes": []}', "at least one keyframe"),
        ('{"schema": "naris.keyframes/1", "frame": "mean", "keyframes": [{"name": "a"}]}', "`anatomy_T_camera`"),
        ('{"schema": "naris.keyframes/1", "frame": "mean", "keyframes": [{"anatomy_T_camera": [[1, 2]]}]}', "4×4"),
        ('{"schema": "naris.keyframes/1", "frame": "mean", "keyframes": [{"anatomy_T_camera": "x"}]}', "4×4"),
        ('{"schema": "naris.keyframes/1", "frame": "mean", "keyframes": 3}', "`keyframes`"),
    ],
)
def test_a_broken_file_gives_one_clear_sentence(tmp_path, content, said) -> None:
    path = tmp_path / "keys.json"
    path.write_text(content)
    with pytest.raises(KeyframeError) as caught:
        read_keyframes(path)
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), 7.0])
def test_a_pose_that_is_none_is_refused_by_name(tmp_path, bad) -> None:
    path = tmp_path / "keys.json"
    write_keyframes(Keyframes.of(random_poses(3, 0), names=["a", "valve", "c"]), path)
    content = json.loads(path.read_text())
    content["keyframes"][1]["anatomy_T_camera"][0][0] = bad
    path.write_text(json.dumps(content))
    with pytest.raises(KeyframeError, match=r"'valve' of keys\.json"):
        read_keyframes(path)


def test_a_missing_file_and_a_folder_without_poses_are_refused(tmp_path) -> None:
    with pytest.raises(KeyframeError, match="no such file"):
        read_keyframes(tmp_path / "keys.json")
    with pytest.raises(KeyframeError, match="none"):
        read_original_keyframes(tmp_path, "mean")


@pytest.mark.parametrize("text", ["", "1 2\n3 4\n", "1 2\n3 x\n5 6\n", "1 nan\n2 0\n3 1\n", "1 0\n2 0\n3 0\n", "\x00"])
def test_a_broken_text_pose_is_refused_by_name(tmp_path, text) -> None:
    (tmp_path / "07.txt").write_text(text)
    with pytest.raises(KeyframeError, match=r"07\.txt"):
        read_original_keyframes(tmp_path, "mean")


def test_keyframes_of_another_anatomy_or_frame_are_refused() -> None:
    keyframes = Keyframes.of(random_poses(2, 0), tetrahedron())
    check_belongs(keyframes, tetrahedron())
    with pytest.raises(KeyframeError, match="saved in"):
        check_belongs(keyframes, tetrahedron(size_mm=11))
    with pytest.raises(KeyframeError, match="'LPS'"):
        check_belongs(keyframes, tetrahedron("LPS"))


def test_one_keyframe_is_no_way() -> None:
    with pytest.raises(KeyframeError, match="two keyframes"):
        interpolate(Keyframes.of(random_poses(1, 0)))


def test_no_keyframe_and_mixed_frames_are_refused() -> None:
    with pytest.raises(KeyframeError, match="at least one"):
        Keyframes(())
    a, b = Keyframes.of(random_poses(1, 0)), Keyframes.of(Pose.identity("LPS", "camera").reshape(1))
    with pytest.raises(KeyframeError, match="one frame"):
        Keyframes(a.keyframes + b.keyframes)


def test_names_that_cannot_name_files_are_refused(tmp_path) -> None:
    with pytest.raises(KeyframeError, match="differ"):
        write_original_keyframes(Keyframes.of(random_poses(2, 0), names=["a", "a"]), tmp_path)
    with pytest.raises(KeyframeError, match="differ"):
        write_original_keyframes(Keyframes.of(random_poses(1, 0), names=["../a"]), tmp_path)
