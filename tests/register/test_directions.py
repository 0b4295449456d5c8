"""Directions as texels, rotations of cameras, and the smooth error against the process that it approximates."""

import numpy as np

from naris.core.camera import Intrinsics
from naris.register.directions import rotations, texel_directions, texels
from naris.register.smooth import smooth_error


def test_each_texel_is_that_of_its_own_direction():
    for size in (8, 32):
        directions = texel_directions(size)
        np.testing.assert_array_equal(texels(directions, size), np.arange(size * size))
        np.testing.assert_allclose(np.linalg.norm(directions, axis=1), 1.0)


def test_a_direction_lies_near_the_middle_of_its_texel():
    d = np.random.default_rng(0).standard_normal((5000, 3))
    d /= np.linalg.norm(d, axis=1, keepdims=True)
    middle = texel_directions(32)[texels(d, 32)]
    assert np.rad2deg(np.arccos((d * middle).sum(axis=1))).max() < 7.5


def test_cameras_cover_what_they_may_and_nothing_else():
    inward = np.array([0.0, 1.0, 0.0])
    turns = rotations(inward, 60.0, 40.0, 10.0)
    np.testing.assert_allclose(turns @ turns.transpose(0, 2, 1), np.tile(np.eye(3), (len(turns), 1, 1)), atol=1e-9)
    np.testing.assert_allclose(np.linalg.det(turns), 1.0)
    assert (turns[:, :, 2] @ inward).min() >= np.cos(np.deg2rad(60.0))
    rng = np.random.default_rng(1)
    wanted = rotations(inward, 55.0, 35.0, 3.0)[rng.integers(0, 2000, 100)]
    cosine = np.einsum("aij,bij->ab", wanted, turns).max(axis=1) / 2 - 0.5
    assert np.rad2deg(np.arccos(cosine)).max() < 16.0


def test_of_any_roll_there_is_one_each():
    turns = rotations(np.array([0.0, 1.0, 0.0]), 30.0, 180.0, 20.0)
    gaps = np.einsum("aij,bij->ab", turns, turns) / 2 - 0.5
    np.fill_diagonal(gaps, -1.0)
    assert gaps.max() < np.cos(np.deg2rad(10.0))


def test_the_smooth_error_has_the_covariance_that_it_stands_for():
    directions = Intrinsics.from_vertical_fov(24, 24, 80.0).rays().reshape(-1, 3)
    angle = np.arccos(np.clip(directions @ directions.T, -1, 1))
    whole = 0.05**2 * np.exp(-0.5 * (angle / np.deg2rad(9.3)) ** 2)
    centred = whole - whole.mean(axis=0) - whole.mean(axis=1)[:, None] + whole.mean()
    found = smooth_error(directions, 0.05, 9.3, 54)
    made = (found.functions / found.precision) @ found.functions.T
    assert len(found.precision) == 54
    assert np.abs(made - centred).max() < 0.2 * 0.05**2
    assert np.trace(made) > 0.97 * np.trace(centred)
    np.testing.assert_allclose(found.functions.mean(axis=0), 0.0, atol=1e-9)
