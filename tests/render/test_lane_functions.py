"""Functions of sixteen numbers against numpy in double precision."""

from __future__ import annotations

import numpy as np
from numba import njit

from naris.render.lane_functions import exponential, logarithm
from naris.render.lanes import load, store


@njit
def _exponentials(x, out):
    for at in range(0, len(x), 16):
        store(out, at, exponential(load(x, at)))


@njit
def _logarithms(x, out):
    for at in range(0, len(x), 16):
        store(out, at, logarithm(load(x, at)))


def test_exponentials_are_right_to_the_last_few_digits() -> None:
    x = np.linspace(-86, 86, 16 * 2000).astype(np.float32)
    out = np.zeros_like(x)
    _exponentials(x, out)
    np.testing.assert_allclose(out, np.exp(x.astype(np.float64)), rtol=5e-7, atol=0)


def test_exponentials_of_what_is_beyond_are_those_of_the_end() -> None:
    x = np.array([-np.inf, -1e30, -86.0, 0.0, 86.0, 1e30] * 8, np.float32)
    out = np.zeros_like(x)
    _exponentials(x, out)
    np.testing.assert_allclose(out, np.exp(np.clip(x.astype(np.float64), -86, 86)), rtol=5e-7)


def test_logarithms_are_right_to_the_last_digit_or_two() -> None:
    x = np.exp(np.linspace(np.log(1.2e-38), np.log(3e38), 16 * 2000)).astype(np.float32)
    out = np.zeros_like(x)
    _logarithms(x, out)
    expected = np.log(x.astype(np.float64))
    np.testing.assert_allclose(out, expected, rtol=2e-7, atol=0)


def test_logarithms_about_one_keep_their_digits() -> None:
    x = (1 + np.linspace(-1e-3, 1e-3, 16 * 100)).astype(np.float32)
    out = np.zeros_like(x)
    _logarithms(x, out)
    np.testing.assert_allclose(out, np.log(x.astype(np.float64)), rtol=3e-7, atol=1e-12)
