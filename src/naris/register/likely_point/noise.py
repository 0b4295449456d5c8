"""How wrong the points and normals of a cloud are, as covariances and as Kent's distribution."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from naris.errors import InputError

_LEAST_VARIANCE_MM2 = 1e-8
_UNIT = 1e-3


@dataclass(frozen=True, eq=False)
class CloudNoise:
    """How wrong a cloud is, everything in its own frame.

    A normal n is seen where m is with a density ∝ exp(κ n·m + β ((a·m)² − (b·m)²)) (Kent 1982): a is the axis along
    which it is more uncertain, b the other one, and β = eccentricity · κ / 2. Without eccentricity that is the
    distribution of von Mises and Fisher. Of small errors 1/κ is the variance in rad² along each axis.

    Attributes:
        covariance_mm2: (3, 3) of all points, or (N, 3, 3) of each.
        concentration: κ of all normals, or (N,) of each.
        eccentricity: from 0 (round) to below 1.
        major: (N, 3) unit axes a, at right angles to the normals; only with an eccentricity.
        farthest_sd: points that lie further from their match than about so many standard deviations count little; no
            such limit where nothing is an outlier.

    Raises:
        InputError: if it is no noise: a covariance that is not positive, a concentration of 0, axes that are missing.
    """

    covariance_mm2: Float[np.ndarray, "*n 3 3"]
    concentration: float | Float[np.ndarray, "n"] = 1.0
    eccentricity: float = 0.0
    major: Float[np.ndarray, "n 3"] | None = None
    farthest_sd: float = np.inf

    def __post_init__(self) -> None:
        covariance = np.asarray(self.covariance_mm2, dtype=np.float64)
        if covariance.shape[-2:] != (3, 3) or not np.isfinite(covariance).all():
            raise InputError("finite covariances (3, 3) or (N, 3, 3)", f"{covariance.shape}", "give mm² in x, y and z")
        if not np.allclose(covariance, np.swapaxes(covariance, -1, -2), rtol=1e-5, atol=1e-9):
            raise InputError("symmetric covariances", "others", "check the order of the numbers")
        least = float(np.linalg.eigvalsh(covariance).min(initial=np.inf))
        if least < _LEAST_VARIANCE_MM2:
            raise InputError(
                f"variances of at least {_LEAST_VARIANCE_MM2:g} mm² in every direction",
                f"{least:.3g}",
                "add what a point may be off by",
            )
        if not (np.asarray(self.concentration) > 0).all() or not np.isfinite(self.concentration).all():
            raise InputError("concentrations above 0", "others", "give 1 / variance in rad² of the normals")
        if not 0 <= self.eccentricity < 1 or (self.eccentricity > 0) != (self.major is not None):
            raise InputError(
                "an eccentricity from 0 to below 1, with axes where it is above 0",
                f"{self.eccentricity} {'without' if self.major is None else 'with'} axes",
                "give both or neither",
            )
        if not self.farthest_sd > 0:
            raise InputError("a limit above 0 standard deviations", f"{self.farthest_sd}", "give 3 or more")

    @staticmethod
    def even(sd_mm: float, sd_rad: float = 1.0, farthest_sd: float = np.inf) -> CloudNoise:
        """The same in every direction: standard deviations of points in mm and of normals in rad.

        Raises:
            InputError: if one is not above 0.
        """
        if not 0 < sd_rad < np.inf:
            raise InputError("a deviation of the normals above 0 rad", f"{sd_rad}", "give what they are off by")
        return CloudNoise(sd_mm**2 * np.eye(3), sd_rad**-2.0, farthest_sd=farthest_sd)


class Axes(NamedTuple):
    """The noise of N points along the axes that it is independent in.

    Attributes:
        turn: (N, 3, 3) rows are the axes of the covariance.
        variance: (N, 3) along them, in mm².
        concentration: (N,) of the normals; 0 where there are none.
        eccentricity: of the noise of the normals.
        normal, major, minor: (N, 3) unit, at right angles to each other; all 0 where there are no normals.
    """

    turn: Float[np.ndarray, "n 3 3"]
    variance: Float[np.ndarray, "n 3"]
    concentration: Float[np.ndarray, "n"]
    eccentricity: float
    normal: Float[np.ndarray, "n 3"]
    major: Float[np.ndarray, "n 3"]
    minor: Float[np.ndarray, "n 3"]


def axes_of(noise: CloudNoise, count: int, normals: Float[np.ndarray, "n 3"] | None) -> Axes:
    """The noise of so many points, with normals or without.

    Raises:
        InputError: if it is of another number of points, or normals or axes are not unit vectors.
    """
    for what, values, rank in (("covariance", noise.covariance_mm2, 3), ("concentration", noise.concentration, 1)):
        if np.ndim(values) == rank and len(np.atleast_1d(values)) != count:
            raise InputError(f"one {what} for each of {count} points", f"{len(np.atleast_1d(values))}", "match them")
    variance, columns = np.linalg.eigh(np.broadcast_to(noise.covariance_mm2, (count, 3, 3)))
    turn = np.ascontiguousarray(np.swapaxes(columns, 1, 2))
    if normals is None:
        zero = np.zeros((count, 3))
        return Axes(turn, variance, np.zeros(count), 0.0, zero, zero, zero)
    normal = _unit("normals", normals, count)
    # Without eccentricity any pair of axes does.
    first = _unit("major axes", noise.major, count) if noise.major is not None else _beside(normal)
    major = first - (first * normal).sum(axis=1, keepdims=True) * normal
    major /= np.linalg.norm(major, axis=1, keepdims=True)
    kappa = np.broadcast_to(np.asarray(noise.concentration, dtype=np.float64), (count,))
    return Axes(turn, variance, kappa, noise.eccentricity, normal, major, np.cross(normal, major))


def _unit(what: str, values: Float[np.ndarray, "n 3"], count: int) -> Float[np.ndarray, "n 3"]:
    values = np.asarray(values, dtype=np.float64)
    length = np.linalg.norm(values, axis=-1, keepdims=True)
    if values.shape != (count, 3) or not (np.abs(length - 1) < _UNIT).all():
        raise InputError(f"{what} ({count}, 3) of unit length", f"{values.shape} or other lengths", "normalise them")
    return np.asarray(values / length)


def _beside(normal: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Some direction that is not along each normal."""
    return np.eye(3)[np.abs(normal).argmin(axis=1)]
