"""Rigid transforms: the axioms of a group, the exponential, and what a camera sees where."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from naris.core.camera import Intrinsics
from naris.core.pose import CAMERA, Pose, distance, rotation_vector, stack
from naris.errors import PoseError

TOLERANCE = {"rtol": 0, "atol": 1e-8}


def vectors(size: float) -> st.SearchStrategy[np.ndarray]:
    return hnp.arrays(np.float64, 3, elements=st.floats(-size, size, allow_subnormal=False))


@st.composite
def poses(draw: st.DrawFn, target: str = "LPS", source: str = CAMERA) -> Pose:
    rotation = Rotation.from_rotvec(draw(vectors(4.0))).as_matrix()
    return Pose.of(rotation, draw(vectors(100.0)), target, source)


@given(poses("a", "b"), poses("b", "c"), poses("c", "d"))
def test_composition_is_associative(a_T_b: Pose, b_T_c: Pose, c_T_d: Pose) -> None:
    left, right = (a_T_b @ b_T_c) @ c_T_d, a_T_b @ (b_T_c @ c_T_d)
    np.testing.assert_allclose(left.matrix, right.matrix, **TOLERANCE)
    assert (left.target, left.source) == (right.target, right.source) == ("a", "d")


@given(poses("a", "b"))
def test_identity_is_neutral_and_the_inverse_undoes(a_T_b: Pose) -> None:
    np.testing.assert_allclose((Pose.identity("a") @ a_T_b).matrix, a_T_b.matrix, **TOLERANCE)
    np.testing.assert_allclose((a_T_b @ Pose.identity("b")).matrix, a_T_b.matrix, **TOLERANCE)
    np.testing.assert_allclose((a_T_b @ a_T_b.inverse()).matrix, np.eye(4), **TOLERANCE)
    np.testing.assert_allclose((a_T_b.inverse() @ a_T_b).matrix, np.eye(4), **TOLERANCE)
    back = a_T_b.inverse()
    assert (back.target, back.source) == ("b", "a")


@given(poses("a", "b"), poses("b", "c"), hnp.arrays(np.float64, (5, 3), elements=st.floats(-100, 100)))
def test_applying_is_an_action(a_T_b: Pose, b_T_c: Pose, points_mm: np.ndarray) -> None:
    np.testing.assert_allclose((a_T_b @ b_T_c).apply(points_mm), a_T_b.apply(b_T_c.apply(points_mm)), **TOLERANCE)


@given(vectors(50.0), vectors(1.75))
def test_log_undoes_exp_below_half_a_turn(rho: np.ndarray, phi: np.ndarray) -> None:
    twist = np.concatenate([rho, phi])
    np.testing.assert_allclose(Pose.exp(twist, "a", "b").log(), twist, rtol=0, atol=1e-7)


@given(poses())
def test_exp_undoes_log(pose: Pose) -> None:
    np.testing.assert_allclose(Pose.exp(pose.log(), "LPS", CAMERA).matrix, pose.matrix, rtol=0, atol=1e-6)


@pytest.mark.parametrize("angle_rad", [0.0, 1e-12, 1e-9, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3, 1.0, 3.0, np.pi - 1e-7])
def test_exp_is_the_exponential_of_the_matrix(angle_rad: float) -> None:
    """Oracle: scipy's general matrix exponential; angles across every switch of series and closed form."""
    axis = np.array([0.36, -0.48, 0.8])
    twist = np.concatenate([[3.0, -7.0, 11.0], angle_rad * axis])
    generator = np.zeros((4, 4))
    generator[:3, :3] = np.cross(np.eye(3), twist[3:])
    generator[:3, 3] = twist[:3]
    pose = Pose.exp(twist, "a", "b")
    np.testing.assert_allclose(pose.matrix, expm(generator), rtol=0, atol=1e-9)
    np.testing.assert_allclose(pose.log(), twist, rtol=0, atol=1e-6)


def test_a_batch_is_its_members() -> None:
    rng = np.random.default_rng(1)
    twists, points = rng.normal(size=(4, 3, 6)), rng.normal(size=(4, 3, 7, 3))
    batch = Pose.exp(twists, "a", "b")
    assert batch.shape == (4, 3)
    for i in range(4):
        for j in range(3):
            single = Pose.exp(twists[i, j], "a", "b")
            np.testing.assert_allclose(batch[i, j].matrix, single.matrix, **TOLERANCE)
            np.testing.assert_allclose(batch[i, j].inverse().matrix, batch.inverse()[i, j].matrix, **TOLERANCE)
            np.testing.assert_allclose(batch.apply(points)[i, j], single.apply(points[i, j]), **TOLERANCE)
            np.testing.assert_allclose(batch.log()[i, j], single.log(), **TOLERANCE)
    np.testing.assert_array_equal(stack([batch[0, 0], batch[1, 0]]).matrix, batch[:2, 0].matrix)
    assert batch.reshape(12).shape == (12,) and len(batch) == 4


@given(poses(), poses(), poses("world", "LPS"))
def test_distance_is_a_metric_that_no_change_of_frame_alters(a: Pose, b: Pose, world_T_lps: Pose) -> None:
    mm, rad = distance(a, b)
    mm_back, rad_back = distance(b, a)
    mm_moved, rad_moved = distance(world_T_lps @ a, world_T_lps @ b)
    np.testing.assert_allclose([mm, rad], [mm_back, rad_back], rtol=0, atol=1e-6)
    np.testing.assert_allclose([mm, rad], [mm_moved, rad_moved], rtol=0, atol=1e-6)
    assert 0 <= rad <= np.pi + 1e-9
    np.testing.assert_allclose(distance(a, a), 0, atol=1e-6)


@given(vectors(3.0))
def test_rotation_vector_agrees_with_opencv(vector: np.ndarray) -> None:
    rotation = cv2.Rodrigues(vector)[0]
    np.testing.assert_allclose(cv2.Rodrigues(rotation_vector(rotation))[0], rotation, rtol=0, atol=1e-6)


# What a camera sees where -------------------------------------------------------------------------------------------

PATIENT_LOOKS_BACK = {"forward": np.array([0.0, 1.0, 0.0]), "up": np.array([0.0, 0.0, 1.0])}
"""A scope in the nostril of a person: it looks posterior (+y), head up (+z)."""


@pytest.mark.parametrize(
    ("landmark_mm", "right", "low"),
    [
        ((3.0, 20.0, 4.0), True, False),  # whoever faces a person has the person's left (+x) on the right
        ((-3.0, 20.0, 4.0), False, False),
        ((3.0, 20.0, -4.0), True, True),
        ((-3.0, 20.0, -4.0), False, True),
    ],
)
def test_a_landmark_appears_in_the_expected_quadrant(landmark_mm: tuple, right: bool, low: bool) -> None:
    """The conventions of docs/conventions.md, proven: world LPS, camera x right, y down, z forward."""
    lps_T_camera = Pose.look(np.zeros(3), **PATIENT_LOOKS_BACK, target="LPS")
    intrinsics = Intrinsics.from_vertical_fov(300, 200, 45)
    pixel, seen = intrinsics.project(lps_T_camera.inverse().apply(np.array(landmark_mm)))
    assert seen
    assert (pixel[0] > 149.5) == right
    assert (pixel[1] > 99.5) == low


def test_look_is_a_right_handed_camera_with_up_up() -> None:
    pose = Pose.look(np.array([1.0, 2.0, 3.0]), **PATIENT_LOOKS_BACK, target="LPS")
    np.testing.assert_allclose(pose.rotation, np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), atol=1e-12)
    np.testing.assert_allclose(pose.position_mm, [1, 2, 3])
    assert (pose.target, pose.source) == ("LPS", CAMERA)


@given(vectors(10.0).filter(lambda v: np.linalg.norm(v) > 1e-3), st.floats(-3, 3))
def test_look_looks_there_whatever_the_roll(forward: np.ndarray, roll_rad: float) -> None:
    pose = Pose.look(np.zeros(3), forward, np.array([0.0, 0.0, 1.0]), "LPS", roll_rad=roll_rad)
    np.testing.assert_allclose(pose.forward, forward / np.linalg.norm(forward), atol=1e-9)


def test_roll_turns_the_camera_clockwise_and_so_the_picture_anticlockwise() -> None:
    turned = Pose.look(np.zeros(3), **PATIENT_LOOKS_BACK, target="LPS", roll_rad=np.pi / 2)
    above = turned.inverse().apply(np.array([0.0, 20.0, 5.0]))
    np.testing.assert_allclose(above, [-5, 0, 20], atol=1e-9)


def test_looking_straight_up_is_no_exception() -> None:
    pose = Pose.look(np.zeros(3), np.array([0.0, 0.0, 2.0]), np.array([0.0, 0.0, 1.0]), "LPS")
    np.testing.assert_allclose(pose.forward, [0, 0, 1])


# Refusals -----------------------------------------------------------------------------------------------------------


def broken(change: str) -> np.ndarray:
    matrix = np.eye(4)
    if change == "nan":
        matrix[0, 3] = np.nan
    elif change == "scale":
        matrix[:3, :3] *= 1.01
    elif change == "mirror":
        matrix[0, 0] = -1
    elif change == "bottom":
        matrix[3, 0] = 0.5
    elif change == "shape":
        return matrix[:3]
    return matrix


@pytest.mark.parametrize(
    ("change", "word"),
    [
        ("nan", "NaN"),
        ("scale", "rigid"),
        ("mirror", "reflection"),
        ("bottom", "last row"),
    ],
)
def test_what_is_not_rigid_is_refused(change: str, word: str) -> None:
    with pytest.raises(PoseError, match=word):
        Pose(broken(change), "a", "b")


def test_frames_that_do_not_meet_are_refused() -> None:
    with pytest.raises(PoseError, match="LPS_T_camera"):
        Pose.identity("LPS", "camera") @ Pose.identity("RAS", "camera")
    with pytest.raises(PoseError, match="one frame"):
        distance(Pose.identity("LPS", "camera"), Pose.identity("RAS", "camera"))
    with pytest.raises(PoseError, match="same two frames"):
        stack([Pose.identity("LPS", "camera"), Pose.identity("RAS", "camera")])
    with pytest.raises(PoseError, match="at least one"):
        stack([])


@pytest.mark.parametrize("forward", [[0.0, 0, 0], [np.nan, 0, 1]])
def test_a_direction_without_length_is_refused(forward: list) -> None:
    with pytest.raises(PoseError, match="viewing direction"):
        Pose.look(np.zeros(3), np.array(forward), np.array([0.0, 0, 1]), "LPS")


def test_a_pose_cannot_be_changed_in_place() -> None:
    matrix = np.eye(4)
    pose = Pose(matrix, "a", "b")
    matrix[0, 3] = 7
    assert pose.position_mm[0] == 0
    with pytest.raises(ValueError, match="read-only"):
        pose.matrix[0, 3] = 7
