"""Building blocks of implicit bodies on a grid: smooth minima, swept tubes, smooth irregularity.

A field is positive inside the lumen and about the distance to the wall in mm near it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from jaxtyping import Float
from scipy.interpolate import BSpline, CubicSpline, PchipInterpolator

Field = Float[np.ndarray, "nx ny nz"]
Number = float | int


@dataclass(frozen=True, eq=False)
class Grid:
    """A regular grid given by its three axes in mm; `u` is x towards the side's lateral wall."""

    x_mm: Float[np.ndarray, "nx"]
    y_mm: Float[np.ndarray, "ny"]
    z_mm: Float[np.ndarray, "nz"]
    spacing_mm: float

    @property
    def x(self) -> Float[np.ndarray, "nx 1 1"]:
        return self.x_mm[:, None, None]

    @property
    def y(self) -> Float[np.ndarray, "1 ny 1"]:
        return self.y_mm[None, :, None]

    @property
    def z(self) -> Float[np.ndarray, "1 1 nz"]:
        return self.z_mm[None, None, :]

    @property
    def shape(self) -> tuple[int, int, int]:
        return len(self.x_mm), len(self.y_mm), len(self.z_mm)

    @property
    def origin_mm(self) -> Float[np.ndarray, "3"]:
        return np.array([self.x_mm[0], self.y_mm[0], self.z_mm[0]], dtype=np.float64)

    def window(self, low_mm: tuple[float, float, float], high_mm: tuple[float, float, float]) -> tuple[slice, ...]:
        """The slices that cover a box."""
        axes = (self.x_mm, self.y_mm, self.z_mm)
        return tuple(
            slice(int(np.searchsorted(axis, low)), int(np.searchsorted(axis, high, side="right")))
            for axis, low, high in zip(axes, low_mm, high_mm, strict=True)
        )

    def part(self, window: tuple[slice, ...]) -> Grid:
        return Grid(self.x_mm[window[0]], self.y_mm[window[1]], self.z_mm[window[2]], self.spacing_mm)


def smooth_min(a: np.ndarray, b: np.ndarray, k_mm: Number | np.ndarray) -> np.ndarray:
    """The smaller of both, rounded where they differ by less than `k_mm` (quadratic; Quilez, "smooth minimum")."""
    k = np.asarray(k_mm, dtype=np.float32)
    h = np.maximum(k - np.abs(a - b), 0) / k
    return np.minimum(a, b) - h * h * (k * np.float32(0.25))


def smooth_max(a: np.ndarray, b: np.ndarray, k_mm: float) -> np.ndarray:
    """The greater of both, rounded where they differ by less than `k_mm`."""
    return -smooth_min(-a, -b, k_mm)


def smooth_min_of(k_mm: float, *several: np.ndarray) -> np.ndarray:
    """The smallest of several, rounded pairwise in their order."""
    return reduce(lambda a, b: smooth_min(a, b, k_mm), several)


def bump(s: np.ndarray, centre: Number | np.ndarray, width: Number) -> np.ndarray:
    """A Gaussian hill of height 1; `width` is its standard deviation."""
    return np.exp(-0.5 * ((s - centre) / width) ** 2)


def step(s: np.ndarray, low: Number, high: Number) -> np.ndarray:
    """0 below `low`, 1 above `high`, smooth between (may also fall: `low` > `high`)."""
    t = np.clip((s - low) / (high - low), 0.0, 1.0)
    return t * t * (3 - 2 * t)


def profile(stations: Sequence[tuple[Number, Number]], s: np.ndarray) -> np.ndarray:
    """A smooth curve through (position, value) that never overshoots, constant outside."""
    where, value = np.asarray(stations, dtype=np.float64).T
    return PchipInterpolator(where, value)(np.clip(s, where[0], where[-1])).astype(np.float32)


def table(
    rows_s: Sequence[Number], columns_t: Sequence[Number], values: np.ndarray, s: np.ndarray, t: np.ndarray
) -> np.ndarray:
    """A surface through a table of values (rows, columns), without overshoot, at all pairs of s and t."""
    along_t = PchipInterpolator(columns_t, values, axis=1)(np.clip(t, columns_t[0], columns_t[-1]))
    return PchipInterpolator(rows_s, along_t, axis=0)(np.clip(s, rows_s[0], rows_s[-1])).astype(np.float32)


def swept_tube(grid: Grid, curves: Float[np.ndarray, "ny n 3"]) -> Field:
    """Distance to a body that each coronal slice cuts in a bent band of varying thickness.

    Args:
        curves: for each y of the grid, n points of (x, z, radius) in mm along the band.

    Returns:
        Outside positive: distance in the coronal plane to the nearest of the n − 1 segments, less its radius there.
    """
    x, z = grid.x, grid.z
    nearest = np.full(grid.shape, np.inf, dtype=np.float32)
    curves = curves.astype(np.float32)
    for a, b in zip(np.moveaxis(curves, 1, 0)[:-1], np.moveaxis(curves, 1, 0)[1:], strict=True):
        ax, az, ar = (a[:, i][None, :, None] for i in range(3))
        dx, dz, dr = (b[:, i][None, :, None] - v for i, v in zip(range(3), (ax, az, ar), strict=True))
        along = ((x - ax) * dx + (z - az) * dz) / np.maximum(dx * dx + dz * dz, np.float32(1e-6))
        np.clip(along, 0, 1, out=along)
        off_x, off_z = x - (ax + along * dx), z - (az + along * dz)
        np.minimum(nearest, np.sqrt(off_x * off_x + off_z * off_z) - (ar + along * dr), out=nearest)
    return nearest


def tube(grid: Grid, points: Float[np.ndarray, "n 4"]) -> Field:
    """Distance to a polyline of (x, y, z, radius) in mm, outside positive."""
    nearest = np.full(grid.shape, np.inf, dtype=np.float32)
    for a, b in zip(points[:-1].astype(np.float32), points[1:].astype(np.float32), strict=True):
        d = b - a
        along = (grid.x - a[0]) * d[0] + (grid.y - a[1]) * d[1] + (grid.z - a[2]) * d[2]
        along = np.clip(along / max(float(d[:3] @ d[:3]), 1e-6), 0, 1).astype(np.float32)
        squares = sum((axis - (a[i] + along * d[i])) ** 2 for i, axis in enumerate((grid.x, grid.y, grid.z)))
        np.minimum(nearest, np.sqrt(squares) - (a[3] + along * d[3]), out=nearest)
    return nearest


def fine_curve(control: Float[np.ndarray, "*rows n k"], count: int) -> Float[np.ndarray, "*rows count k"]:
    """`count` points on the cubic splines through n control points (second axis from the end)."""
    n = control.shape[-2]
    return CubicSpline(np.arange(n), control, axis=-2)(np.linspace(0, n - 1, count))


def irregularity(grid: Grid, wavelength_mm: float, rng: np.random.Generator) -> Field:
    """Smooth noise of about unit variance, from a random lattice of cubic B-splines.

    The lattice covers a fixed box, so that the same generator gives the same shape at any resolution.
    """
    knot_mm = wavelength_mm / 2
    reach_mm = 64.0
    count = int(2 * reach_mm / knot_mm) + 1
    lattice = rng.standard_normal((count, count, count)).astype(np.float32)
    for axis, where in enumerate((grid.x_mm, grid.y_mm, grid.z_mm)):
        knots = (np.arange(count + 4) - 2) * knot_mm - reach_mm
        basis = BSpline.design_matrix(np.clip(where, knots[3], knots[count] - 1e-3), knots, 3).toarray()
        lattice = np.moveaxis(np.tensordot(basis.astype(np.float32), lattice, axes=(1, axis)), 0, axis)
    return lattice / np.float32(0.47**1.5)
