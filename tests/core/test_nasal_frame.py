"""The same place in a nose has the same coordinates however the head lies, and "in" runs along the nasal floor."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from naris.core.nasal_frame import NasalFrame
from naris.errors import InputError
from tests import simulated_head

MARKS = {
    "left.nostril": np.array([7.0, -38.0, -25.0]),
    "right.nostril": np.array([-7.0, -38.0, -25.0]),
    "left.choana": np.array([8.0, 28.0, -7.0]),
    "right.choana": np.array([-8.0, 28.0, -7.0]),
}


@given(st.integers(0, 2**31))
def test_a_turned_and_moved_head_has_the_same_coordinates(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turn, shift = Rotation.random(random_state=rng).as_matrix(), rng.normal(0, 100, 3)
    points = rng.normal(0, 40, (5, 3))
    moved = NasalFrame.of({name: turn @ at + shift for name, at in MARKS.items()})
    frame = NasalFrame.of(MARKS)
    np.testing.assert_allclose(moved.coordinates_mm(points @ turn.T + shift), frame.coordinates_mm(points), atol=1e-9)
    np.testing.assert_allclose(moved.points_mm(frame.coordinates_mm(points)), points @ turn.T + shift, atol=1e-9)
    assert moved.depth_mm == pytest.approx(frame.depth_mm)


def test_axes_are_those_of_the_patient_and_right_handed() -> None:
    frame = NasalFrame.of(MARKS)
    np.testing.assert_allclose(frame.axes.T @ frame.axes, np.eye(3), atol=1e-12)
    assert np.linalg.det(frame.axes) == pytest.approx(1)
    assert (np.diag(frame.axes) > 0.99).all()  # of a head that lies straight in LPS
    left, into, _ = frame.coordinates_mm(MARKS["left.choana"])
    assert left == pytest.approx(8.0, abs=1e-9)
    assert into == pytest.approx(frame.depth_mm)
    left, into, up = frame.coordinates_mm(np.array([-3.0, -20.0, 10.0]))
    assert left < 0 < into < frame.depth_mm
    assert up > 0


def test_the_axes_of_the_built_in_nose_are_its_own() -> None:
    frame = NasalFrame.of(simulated_head.bare_nose().landmarks_mm)
    apart = np.rad2deg(np.arccos(np.clip(np.diag(frame.axes), -1, 1)))
    assert apart.max() < 3


def test_without_the_landmarks_it_says_which() -> None:
    with pytest.raises(InputError, match=r"no right\.choana"):
        NasalFrame.of({name: at for name, at in MARKS.items() if name != "right.choana"})
    with pytest.raises(InputError, match="one line"):
        NasalFrame.of(dict.fromkeys(MARKS, np.zeros(3)))
