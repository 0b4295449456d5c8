"""Six numbers and rotations: laws, and scipy as the independent oracle."""

from __future__ import annotations

import numpy as np
import torch
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from naris.model.rotation import angle_between, matrix_of_six, rotation_vector, six_of_matrix


def _rotations(seed: int, n: int = 8) -> torch.Tensor:
    return torch.from_numpy(Rotation.random(n, rng=np.random.default_rng(seed)).as_matrix())


@given(st.integers(0, 2**31))
def test_any_six_numbers_give_a_rotation(seed: int) -> None:
    six = torch.from_numpy(np.random.default_rng(seed).normal(size=(8, 6)))
    rotation = matrix_of_six(six)
    assert torch.allclose(rotation @ rotation.transpose(-1, -2), torch.eye(3, dtype=torch.float64), atol=1e-9)
    assert torch.allclose(torch.linalg.det(rotation), torch.ones(8, dtype=torch.float64))


@given(st.integers(0, 2**31))
def test_a_rotation_comes_back_from_its_six_numbers_at_any_length(seed: int) -> None:
    rotation = _rotations(seed)
    assert torch.allclose(matrix_of_six(3.7 * six_of_matrix(rotation)), rotation, atol=1e-9)


@given(st.integers(0, 2**31))
def test_angle_and_vector_agree_with_scipy(seed: int) -> None:
    a, b = _rotations(seed), _rotations(seed + 1)
    vector = Rotation.from_matrix((a.transpose(-1, -2) @ b).numpy()).as_rotvec()
    assert np.allclose(angle_between(a, b).numpy(), np.linalg.norm(vector, axis=1), atol=4e-3)
    near_half_turn = np.linalg.norm(vector, axis=1) > np.pi - 1e-2
    ours = rotation_vector(a.transpose(-1, -2) @ b).numpy()
    assert np.allclose(ours[~near_half_turn], vector[~near_half_turn], atol=1e-6)


def test_small_rotations_keep_their_vector() -> None:
    vector = np.array([[1e-4, -2e-4, 3e-4], [0.0, 0.0, 0.0]])
    rotation = torch.from_numpy(Rotation.from_rotvec(vector).as_matrix())
    assert np.allclose(rotation_vector(rotation).numpy(), vector, atol=1e-12)


def test_the_angle_has_a_finite_gradient_where_it_is_zero_and_where_it_is_largest() -> None:
    half_turn = torch.diag(torch.tensor([1.0, -1.0, -1.0]))
    for other in (torch.eye(3), half_turn):
        six = six_of_matrix(torch.eye(3)).clone().requires_grad_()
        angle_between(matrix_of_six(six), other).backward()
        assert torch.isfinite(six.grad).all()
