"""The parts of a depth network's error are found again in errors that were drawn of them."""

from __future__ import annotations

import numpy as np
import pytest

from naris.evaluate.depth import DepthErrors, error_model

CELLS, CELL_DEG, CLAIM = 24, 3.0, 0.1


def drawn(n: int, scale: float, smooth: float, reach_deg: float, own: float) -> DepthErrors:
    rng = np.random.default_rng(0)
    place = np.stack(np.meshgrid(np.arange(CELLS), np.arange(CELLS)), axis=-1).reshape(-1, 2) * CELL_DEG
    angle = np.linalg.norm(place[:, None] - place[None], axis=2)
    root = np.linalg.cholesky(np.exp(-0.5 * (angle / reach_deg) ** 2) + 1e-6 * np.eye(len(place)))
    field = smooth * (rng.standard_normal((n, len(place))) @ root.T)
    off = scale * rng.standard_normal((n, 1)) + field + own * rng.standard_normal(field.shape)
    shape = (n, CELLS, CELLS)
    return DepthErrors(CLAIM * off.reshape(shape), np.full(shape, CLAIM), CELL_DEG)


def test_the_parts_are_found_again() -> None:
    found = error_model(drawn(150, 1.5, 0.8, 9.0, 0.3))
    assert found.scale == pytest.approx(1.5, rel=0.2)
    assert found.smooth == pytest.approx(0.8, rel=0.1)
    assert found.reach_deg == pytest.approx(9.0, rel=0.1)
    assert 0.3 < found.own < 0.55  # what is smooth differs a little from one cell to the next, too


def test_what_is_not_known_is_left_out() -> None:
    errors = drawn(60, 1.0, 0.5, 9.0, 0.3)
    holed = errors.log_error.copy()
    holed[:, :4] = np.nan
    found = error_model(errors._replace(log_error=holed))
    assert found.smooth == pytest.approx(0.5, rel=0.15)


def test_a_factor_is_no_error_of_shape() -> None:
    errors = DepthErrors(np.full((3, 4, 4), 0.2), np.full((3, 4, 4), 0.1), 3.0)
    np.testing.assert_allclose(errors.scale, 0.2)
    np.testing.assert_allclose(errors.shape, 0.0, atol=1e-12)
