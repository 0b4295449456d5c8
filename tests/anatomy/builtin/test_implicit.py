"""The building blocks against their laws and against slow or analytic references."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from naris.anatomy.builtin.implicit import (
    Grid,
    bump,
    irregularity,
    profile,
    smooth_max,
    smooth_min,
    step,
    swept_tube,
    tube,
)
from naris.anatomy.level_set import only_lumen, surface
from naris.errors import InputError

NUMBERS = st.floats(-50, 50, width=32)


def grid(low: float, high: float, spacing: float) -> Grid:
    axis = np.arange(low, high + spacing / 2, spacing, dtype=np.float32)
    return Grid(axis, axis, axis, spacing)


@given(a=NUMBERS, b=NUMBERS, k=st.floats(0.125, 8, width=32))
def test_smooth_minimum_lies_a_little_below_the_minimum(a: float, b: float, k: float) -> None:
    pair = np.float32([a]), np.float32([b])
    value, low = float(smooth_min(*pair, k)[0]), min(pair[0][0], pair[1][0])
    assert low - k / 4 - 1e-4 <= value <= low + 1e-5
    assert value == pytest.approx(float(smooth_min(*pair[::-1], k)[0]), abs=1e-5)
    if abs(a - b) > k + 1e-3:
        assert value == pytest.approx(low, abs=1e-5)
    assert float(smooth_max(-pair[0], -pair[1], k)[0]) == pytest.approx(-value, abs=1e-5)


def test_steps_bumps_and_profiles_keep_their_limits() -> None:
    s = np.linspace(-5, 15, 201)
    assert (np.diff(step(s, 0, 10)) >= 0).all() and step(s, 0, 10)[[0, -1]].tolist() == [0, 1]
    assert (np.diff(step(s, 10, 0)) <= 0).all()
    assert bump(s, 3, 2).max() == pytest.approx(1, abs=1e-3)
    through = [(0, 1.0), (2, 5.0), (3, 4.5), (9, 0.0)]
    curve = profile(through, s)
    assert curve.max() <= 5.0 + 1e-6 and curve.min() >= -1e-6
    assert np.interp([0, 2, 3, 9], s, curve) == pytest.approx([1, 5, 4.5, 0], abs=0.02)


def test_a_tube_around_one_segment_is_a_capsule() -> None:
    g = grid(-4, 4, 0.5)
    field = tube(g, np.array([[0.0, 0, -2, 1], [0.0, 0, 2, 1]]))
    x, y, z = np.meshgrid(g.x_mm, g.y_mm, g.z_mm, indexing="ij")
    capsule = np.sqrt(x**2 + y**2 + np.maximum(np.abs(z) - 2, 0) ** 2) - 1
    assert np.abs(field - capsule).max() < 1e-5


def test_a_swept_tube_agrees_with_a_loop() -> None:
    g = grid(-3, 3, 0.75)
    rng = np.random.default_rng(1)
    curves = rng.uniform(-2, 2, (len(g.y_mm), 5, 3))
    curves[..., 2] = rng.uniform(0.1, 1, curves.shape[:2])
    field = swept_tube(g, curves)
    for i, j, k in rng.integers(0, len(g.x_mm), (60, 3)):
        point = np.array([g.x_mm[i], g.z_mm[k]])
        best = np.inf
        for a, b in zip(curves[j, :-1], curves[j, 1:], strict=True):
            along = np.linspace(0, 1, 2001)[:, None]
            line = a + along * (b - a)
            best = min(best, (np.linalg.norm(point - line[:, :2], axis=1) - line[:, 2]).min())
        # The body is a union of bands whose radius belongs to the nearest point of the axis: at most a little thinner.
        assert best - 1e-3 <= field[i, j, k] <= best + 0.9


def test_irregularity_is_the_same_at_any_resolution_and_of_unit_variance() -> None:
    fine, coarse = grid(-20, 20, 0.5), grid(-20, 20, 1.0)
    noise = irregularity(fine, 6.0, np.random.default_rng(5))
    assert np.abs(noise[::2, ::2, ::2] - irregularity(coarse, 6.0, np.random.default_rng(5))).max() < 1e-4
    assert noise.std() == pytest.approx(1, abs=0.15)
    assert np.abs(noise.mean()) < 0.15
    assert np.abs(np.diff(noise, axis=0)).max() < 1.2  # half a millimetre apart: smooth


def test_a_ball_comes_out_closed_outwards_and_alone() -> None:
    g = grid(-6, 6, 0.5)
    x, y, z = np.meshgrid(g.x_mm, g.y_mm, g.z_mm, indexing="ij")
    ball = 4 - np.sqrt(x**2 + y**2 + z**2)
    stray = 0.8 - np.sqrt((x - 5.2) ** 2 + (y - 5.2) ** 2 + (z - 5.2) ** 2)
    island = np.sqrt(x**2 + y**2 + z**2) - 1
    field = only_lumen(np.minimum(np.maximum(ball, stray), island).astype(np.float32))
    vertices, faces = surface(field, g.origin_mm, g.spacing_mm)
    radius = np.linalg.norm(vertices, axis=1)
    assert np.abs(radius - 4).max() < 0.05
    a, b, c = (vertices[faces[:, i]] for i in range(3))
    assert (np.einsum("ij,ij->i", np.cross(b - a, c - a), a + b + c) > 0).all()
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(4 / 3 * np.pi * 64, rel=0.02)


def test_a_nose_without_air_is_refused() -> None:
    with pytest.raises(InputError, match="lumen"):
        only_lumen(np.full((4, 4, 4), -1.0, dtype=np.float32))
