"""The logistic regression: finds what answers were drawn by, and the laws of its optimum."""

from __future__ import annotations

import numpy as np
import pytest

from naris.evaluate.logistic import fit_logistic


def drawn(n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    x = rng.standard_normal((n, 3)) * np.array([1.0, 10.0, 0.1]) + np.array([0.0, 5.0, 1.0])
    chance = 1 / (1 + np.exp(-(x @ np.array([1.0, -0.2, 5.0]) - 4.0)))
    return x, (rng.random(n) < chance).astype(float)


def test_it_finds_what_the_answers_were_drawn_by() -> None:
    x, y = drawn(40_000)
    weights, bias = fit_logistic(x, y, np.ones(len(y)), 0.0)
    np.testing.assert_allclose(weights, [1.0, -0.2, 5.0], rtol=0.1)
    assert bias == pytest.approx(-4.0, rel=0.15)


def test_on_average_it_says_what_happens() -> None:
    x, y = drawn(2_000)
    weight = np.random.default_rng(1).uniform(0.2, 2.0, len(y))
    weights, bias = fit_logistic(x, y, weight)
    said = 1 / (1 + np.exp(-(x @ weights + bias)))
    assert weight @ said == pytest.approx(weight @ y, rel=1e-3)


def test_a_row_twice_is_a_row_of_twice_the_weight() -> None:
    x, y = drawn(300)
    twice = fit_logistic(np.concatenate([x, x[:100]]), np.concatenate([y, y[:100]]), np.ones(400), 0.0)
    heavy = fit_logistic(x, y, np.where(np.arange(300) < 100, 2.0, 1.0), 0.0)
    np.testing.assert_allclose(twice[0], heavy[0], rtol=1e-2)


def test_a_feature_that_never_changes_says_nothing_and_breaks_nothing() -> None:
    x, y = drawn(500)
    weights, bias = fit_logistic(np.column_stack([x, np.zeros(500)]), y, np.ones(500))
    assert np.isfinite(weights).all() and np.isfinite(bias)
    assert weights[3] == pytest.approx(0.0, abs=1e-6)
