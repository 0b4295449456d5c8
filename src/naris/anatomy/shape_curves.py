"""How good a statistical shape model is, by the number of its modes: compactness, generalisation and specificity.

The three measures of R. Davies, C. Twining and C. Taylor, "Statistical Models of Shape" (2008), chapter 9, and
M. Styner et al., "Evaluation of 3D correspondence methods for model building" (IPMI 2003). Distances between shapes are
root mean squares over corresponding vertices, so that all follow from the shapes' products with each other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from naris.errors import InputError

MOST_SD = 2.5
"""Beyond so many standard deviations nothing is drawn from a shape model."""

_DRAWN, _SEED = 1000, 0
_NONE = 1e-9  # of the greatest variance: a mode with less is none


@dataclass(frozen=True, eq=False)
class ShapeCurves:
    """What a model of N shapes is worth with its first 0, 1, 2, … modes; distances in mm, the less the better.

    Attributes:
        compactness: (N,) the share of the variance that those modes have.
        generalisation_mm: (N − 1,) how far a shape is from the nearest that the model of the other N − 1 can make, the
            mean over all left out in turn.
        specificity_mm: (N,) how far a shape drawn from the model is from the nearest that it was built from, the mean
            of a thousand.

    Raises:
        InputError: if lengths do not go together, or a number is none.
    """

    compactness: Float[np.ndarray, "c"]
    generalisation_mm: Float[np.ndarray, "g"]
    specificity_mm: Float[np.ndarray, "s"]

    def __post_init__(self) -> None:
        curves = (self.compactness, self.generalisation_mm, self.specificity_mm)
        lengths = [len(curve) for curve in curves]
        if lengths != [lengths[0], lengths[0] - 1, lengths[0]] or not all(np.isfinite(one).all() for one in curves):
            raise InputError("three curves of a shape model", f"{lengths} numbers", "build the model again")


def principal(
    products: Float[np.ndarray, "n n"],
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "n m"]]:
    """Variances of the modes of N shapes, the greatest first, and how much of each shape every mode is made of.

    Args:
        products: of the shapes, each less their mean, with each other.

    Returns:
        N − 1 variances (of the sum over all coordinates that `products` is of), and as many unit vectors.
    """
    values, vectors = np.linalg.eigh(products / (len(products) - 1))
    order = np.argsort(values)[::-1][: len(products) - 1]
    return np.maximum(values[order], 0.0), vectors[:, order]


def shape_curves(products: Float[np.ndarray, "n n"], vertices: int) -> ShapeCurves:
    """The curves of the model of N shapes.

    Args:
        products: of the shapes, each less their mean, with each other, in mm².
        vertices: how many each has.
    """
    squares_mm2 = products / vertices
    values, _ = principal(squares_mm2)
    share = values / max(float(values.sum()), 1e-12)
    left_out = [_missed_mm(squares_mm2, one) for one in range(len(products))]
    return ShapeCurves(
        np.append(0.0, np.cumsum(share)), np.mean(left_out, axis=0), _specificity_mm(squares_mm2, _DRAWN)
    )


def _missed_mm(squares_mm2: Float[np.ndarray, "n n"], one: int) -> Float[np.ndarray, "g"]:
    """How far one shape is from what the first 0, 1, 2, … modes of the others make of it."""
    others = np.delete(np.arange(len(squares_mm2)), one)
    among, with_one = squares_mm2[np.ix_(others, others)], squares_mm2[others, one]
    # Less the mean of the others: their products with each other, and with the shape that was left out.
    to_one = with_one - with_one.mean() - among.mean(axis=1) + among.mean()
    centred = among - among.mean(axis=0) - among.mean(axis=1)[:, None] + among.mean()
    off_mm2 = squares_mm2[one, one] - 2 * with_one.mean() + among.mean()
    values, vectors = principal(centred)
    length = np.sqrt(values * (len(others) - 1))
    real = values > _NONE * max(float(values[0]), 1e-300)
    along = np.where(real, (vectors.T @ to_one) / np.where(real, length, 1.0), 0.0)
    return np.asarray(np.sqrt(np.maximum(off_mm2 - np.append(0.0, np.cumsum(along**2)), 0.0)))


def _specificity_mm(squares_mm2: Float[np.ndarray, "n n"], count: int) -> Float[np.ndarray, "n"]:
    """How far shapes drawn with the first 0, 1, 2, … modes are from the nearest of the model's, on average."""
    _, vectors = principal(squares_mm2)
    drawn = np.random.default_rng(_SEED).standard_normal((count, vectors.shape[1]))
    drawn = np.clip(drawn, -MOST_SD, MOST_SD) / np.sqrt(len(squares_mm2) - 1)
    mixed = np.zeros((count, len(squares_mm2)))  # how much of each shape is in each that is drawn
    means = []
    for mode in range(vectors.shape[1] + 1):
        if mode:
            mixed = mixed + drawn[:, mode - 1, None] * vectors[:, mode - 1]
        with_all = mixed @ squares_mm2
        own = (with_all * mixed).sum(axis=1)
        apart_mm2 = own[:, None] - 2 * with_all + np.diag(squares_mm2)
        means.append(float(np.sqrt(np.maximum(apart_mm2.min(axis=1), 0.0)).mean()))
    return np.array(means)
