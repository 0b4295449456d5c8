"""A lattice in the patient: there and back, and what is no lattice is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from naris.core.volume import Volume
from naris.errors import ScanError

VALUES = np.zeros((5, 4, 3), np.int16)


def affine(seed: int, shear: float = 0.0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    matrix = np.eye(4)
    slanted = np.array([[1, 0, 0], [0, 1, shear], [0, 0, 1.0]])
    matrix[:3, :3] = Rotation.random(rng=rng).as_matrix() @ slanted * rng.uniform(0.3, 3, 3)
    matrix[:3, 3] = rng.normal(size=3) * 100
    return matrix


@given(seed=st.integers(0, 2**32 - 1), shear=st.floats(-0.5, 0.5))
def test_points_come_back_and_all_lie_within_the_bounds(seed: int, shear: float) -> None:
    volume = Volume(VALUES, affine(seed, shear))
    index = np.random.default_rng(seed).uniform(0, 1, (50, 3)) * (np.array(volume.shape) - 1)
    points = volume.points_mm(index)
    np.testing.assert_allclose(volume.index(points), index, atol=1e-9)
    low, high = volume.bounds_mm
    assert (points >= low - 1e-9).all() and (points <= high + 1e-9).all()
    assert volume.skew_deg == pytest.approx(np.rad2deg(np.arctan(abs(shear))), abs=1e-5)


def test_spacing_and_axes_are_those_of_the_columns() -> None:
    matrix = np.diag([0.5, -0.7, 2.0, 1.0])
    volume = Volume(VALUES, matrix)
    np.testing.assert_allclose(volume.spacing_mm, [0.5, 0.7, 2.0])
    np.testing.assert_allclose(volume.axes, np.diag([1, -1, 1]))


@pytest.mark.parametrize(
    ("values", "matrix"),
    [
        (VALUES[0], np.eye(4)),
        (VALUES, np.diag([1.0, 1, 0, 1])),
        (VALUES, np.diag([1.0, 1, np.inf, 1])),
        (VALUES, np.array([[1.0, 0, 0, 0], [0, 1, 1, 0], [0, 1, 1, 0], [0, 0, 0, 1]])),
        (VALUES, np.diag([1.0, 1, 1, 2])),
        (VALUES[:0], np.eye(4)),
    ],
)
def test_what_is_no_lattice_is_refused(values: np.ndarray, matrix: np.ndarray) -> None:
    with pytest.raises((ScanError, TypeError)):
        Volume(values, matrix)
