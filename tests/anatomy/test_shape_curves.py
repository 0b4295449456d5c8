"""The curves of a shape model: of shapes from a known Gaussian, and against a slow reference."""

from __future__ import annotations

import numpy as np
import pytest

from naris.anatomy.shape_curves import MOST_SD, ShapeCurves, shape_curves
from naris.errors import InputError

VERTICES = 120


def curves_of(shapes: np.ndarray) -> ShapeCurves:
    """Of shapes (N, 3 V)."""
    centred = shapes - shapes.mean(axis=0)
    return shape_curves(centred @ centred.T, shapes.shape[1] // 3)


def drawn(rng: np.random.Generator, count: int, sd_mm: list[float], noise_mm: float = 0.0) -> np.ndarray:
    """Shapes around one, along as many directions as there are deviations (root mean squares over the vertices)."""
    modes = np.linalg.qr(rng.standard_normal((3 * VERTICES, len(sd_mm))))[0].T * np.sqrt(VERTICES)
    noise = noise_mm * rng.standard_normal((count, 3 * VERTICES)) / np.sqrt(3)
    middle = 20 * rng.standard_normal(3 * VERTICES)
    return middle + (rng.standard_normal((count, len(sd_mm))) * sd_mm) @ modes + noise


def rms(shift: np.ndarray) -> np.ndarray:
    return np.linalg.norm(shift, axis=-1) / np.sqrt(VERTICES)


def test_a_gaussian_of_three_modes_needs_three() -> None:
    sd = [3.0, 2.0, 1.0]
    curves = curves_of(drawn(np.random.default_rng(0), 120, sd))
    expected = np.append(0, np.cumsum(np.square(sd))) / np.square(sd).sum()
    np.testing.assert_allclose(curves.compactness[:4], expected, atol=0.06)
    np.testing.assert_allclose(curves.compactness[3:], 1.0)
    # What is left out after two modes is normal with the deviation of the third: the mean of its size is 0.798 of it.
    assert curves.generalisation_mm[2] == pytest.approx(np.sqrt(2 / np.pi) * sd[2], rel=0.2)
    np.testing.assert_allclose(curves.generalisation_mm[3:], 0.0, atol=1e-5)
    assert (np.diff(curves.generalisation_mm) < 1e-9).all()
    # Without modes the mean is drawn, again and again; with all three, shapes that lie among 120 others.
    assert curves.specificity_mm[0] < curves.specificity_mm[3] < 1.5
    np.testing.assert_allclose(curves.specificity_mm[4:], curves.specificity_mm[3], atol=1e-6)


def test_noise_that_no_mode_has_is_never_generalised() -> None:
    curves = curves_of(drawn(np.random.default_rng(1), 30, [3.0, 2.0], noise_mm=0.5))
    assert curves.generalisation_mm[0] > 2.0
    assert 0.4 < curves.generalisation_mm[-1] < curves.generalisation_mm[2] < 0.6


def test_the_same_as_with_the_shapes_themselves() -> None:
    shapes = drawn(np.random.default_rng(2), 7, [3.0, 2.0, 1.0, 0.5], noise_mm=0.3)
    curves = curves_of(shapes)
    missed = np.zeros((7, 6))
    for one in range(7):
        others = np.delete(shapes, one, axis=0)
        off = shapes[one] - others.mean(axis=0)
        axes = np.linalg.svd(others - others.mean(axis=0), full_matrices=False)[2]
        for count in range(6):
            missed[one, count] = rms(off - axes[:count].T @ (axes[:count] @ off))
    np.testing.assert_allclose(curves.generalisation_mm, missed.mean(axis=0), atol=1e-9)
    _, lengths, axes = np.linalg.svd(shapes - shapes.mean(axis=0), full_matrices=False)
    rng = np.random.default_rng(3)
    for count in range(7):
        made = np.clip(rng.standard_normal((4000, count)), -MOST_SD, MOST_SD)
        made = shapes.mean(axis=0) + (made * lengths[:count] / np.sqrt(6)) @ axes[:count]
        nearest = rms(made[:, None] - shapes[None]).min(axis=1)
        assert curves.specificity_mm[count] == pytest.approx(nearest.mean(), rel=0.03)
    np.testing.assert_allclose(curves.compactness[1:], np.cumsum(lengths[:6] ** 2) / (lengths**2).sum())


def test_shapes_that_are_all_the_same_have_no_modes() -> None:
    curves = curves_of(np.tile(np.arange(30.0), (4, 1)))
    for values in vars(curves).values():
        np.testing.assert_allclose(values, 0.0)


@pytest.mark.parametrize("lengths", [(3, 2, 2), (3, 3, 3), (2, 2, 2)])
def test_curves_that_do_not_go_together_are_refused(lengths: tuple[int, int, int]) -> None:
    with pytest.raises(InputError, match="three curves"):
        ShapeCurves(*(np.zeros(length) for length in lengths))
