"""Intrinsics: how a camera maps points in front of it (x right, y down, z forward) to pixels.

Integer pixel coordinates are pixel centres. Lens models follow OpenCV: `Pinhole`, `Brown`
(radial and tangential, Brown 1966 as in OpenCV's `calib3d`) and `Fisheye` (Kannala and Brandt 2006,
OpenCV's `fisheye`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float

from naris.errors import InputError

_UNDISTORT_ITERATIONS = 30
_UNDISTORT_TOLERANCE = 1e-9


@dataclass(frozen=True)
class Pinhole:
    """No distortion."""

    kind: Literal["pinhole"] = "pinhole"

    def distort(self, xy: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        return xy

    def undistort(self, xy: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        return xy


@dataclass(frozen=True)
class Brown:
    """Radial (k1, k2, k3) and tangential (p1, p2) distortion of normalised coordinates x/z, y/z."""

    k1: float = 0.0
    k2: float = 0.0
    p1: float = 0.0
    p2: float = 0.0
    k3: float = 0.0
    kind: Literal["brown"] = "brown"

    def distort(self, xy: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        x, y = xy[..., 0], xy[..., 1]
        r2 = x * x + y * y
        radial = 1 + r2 * (self.k1 + r2 * (self.k2 + r2 * self.k3))
        dx = 2 * self.p1 * x * y + self.p2 * (r2 + 2 * x * x)
        dy = self.p1 * (r2 + 2 * y * y) + 2 * self.p2 * x * y
        return np.stack([x * radial + dx, y * radial + dy], axis=-1)

    def undistort(self, xy: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """By Newton's method; NaN where the model cannot be inverted (past its fold)."""
        return _newton_inverse(self.distort, xy)


@dataclass(frozen=True)
class Fisheye:
    """Angle polynomial theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)."""

    k1: float = 0.0
    k2: float = 0.0
    k3: float = 0.0
    k4: float = 0.0
    kind: Literal["fisheye"] = "fisheye"

    def bend(self, theta_rad: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        t2 = theta_rad * theta_rad
        return np.asarray(theta_rad * (1 + t2 * (self.k1 + t2 * (self.k2 + t2 * (self.k3 + t2 * self.k4)))))

    def unbend(self, theta_d: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """The inverse of `bend` on its first rising branch; NaN beyond it."""
        theta = np.array(theta_d, dtype=np.float64)
        for _ in range(_UNDISTORT_ITERATIONS):
            t2 = theta * theta
            slope = 1 + t2 * (3 * self.k1 + t2 * (5 * self.k2 + t2 * (7 * self.k3 + t2 * 9 * self.k4)))
            step = (self.bend(theta) - theta_d) / np.where(np.abs(slope) < 1e-6, 1e-6, slope)
            theta = np.clip(theta - step, 0.0, np.pi)
        return np.where(np.abs(self.bend(theta) - theta_d) < 1e-7, theta, np.nan)


Lens = Pinhole | Brown | Fisheye


@dataclass(frozen=True)
class Intrinsics:
    """The size of a picture, focal lengths and principal point in pixels, and the lens.

    Raises:
        InputError: if a size or focal length is not positive and finite.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    lens: Lens = Pinhole()

    def __post_init__(self) -> None:
        numbers = (self.width, self.height, self.fx, self.fy)
        if not (np.isfinite([*numbers, self.cx, self.cy]).all() and min(numbers) > 0):
            raise InputError(
                "intrinsics with positive sizes and focal lengths in pixels",
                f"{self.width}x{self.height}, fx {self.fx}, fy {self.fy}, cx {self.cx}, cy {self.cy}",
                "check the camera calibration",
            )

    @staticmethod
    def from_vertical_fov(width: int, height: int, fov_deg: float, lens: Lens = Pinhole()) -> Intrinsics:
        """Square pixels, principal point in the middle, `fov_deg` between the outer edges of top and bottom row.

        For a fisheye the field of view counts along the bent ray.
        """
        if not 0 < fov_deg < (360 if isinstance(lens, Fisheye) else 180):
            raise InputError("a vertical field of view above 0 and below 180 degrees", f"{fov_deg}", "give degrees")
        half_rad = np.deg2rad(fov_deg) / 2
        if isinstance(lens, Fisheye):
            reach = float(lens.bend(np.array(half_rad)))
        else:
            reach = float(lens.distort(np.array([0.0, np.tan(half_rad)]))[1])
        focal = height / 2 / reach
        return Intrinsics(width, height, focal, focal, (width - 1) / 2, (height - 1) / 2, lens)

    @property
    def vertical_fov_deg(self) -> float:
        """The angle between the outer edges of the top and the bottom row, through the principal column."""
        edges = self.unproject(np.array([[self.cx, -0.5], [self.cx, self.height - 0.5]]))
        return float(np.rad2deg(np.arccos(np.clip(edges[0] @ edges[1], -1, 1))))

    def project(self, points_mm: Float[np.ndarray, "*n 3"]) -> tuple[Float[np.ndarray, "*n 2"], Bool[np.ndarray, "*n"]]:
        """Pixels of points in the camera frame, and which of them lie in front and inside the picture."""
        points_mm = np.asarray(points_mm, dtype=np.float64)
        x, y, z = points_mm[..., 0], points_mm[..., 1], points_mm[..., 2]
        if isinstance(self.lens, Fisheye):
            radius = np.hypot(x, y)
            bent = self.lens.bend(np.arctan2(radius, z))
            scale = np.where(radius > 1e-12, bent / np.where(radius > 1e-12, radius, 1.0), 1 / np.where(z == 0, 1, z))
            xy = np.stack([x * scale, y * scale], axis=-1)
            front = radius + np.abs(z) > 0
        else:
            front = z > 1e-9
            safe = np.where(front, z, 1.0)
            xy = self.lens.distort(np.stack([x / safe, y / safe], axis=-1))
        pixels = xy * np.array([self.fx, self.fy]) + np.array([self.cx, self.cy])
        size = np.array([self.width, self.height])
        inside = ((pixels >= -0.5) & (pixels < size - 0.5)).all(axis=-1)
        return pixels, np.asarray(front & inside)

    def unproject(self, pixels: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 3"]:
        """Unit directions in the camera frame; NaN where the lens model has no ray."""
        xy = (np.asarray(pixels, dtype=np.float64) - [self.cx, self.cy]) / [self.fx, self.fy]
        if isinstance(self.lens, Fisheye):
            bent = np.linalg.norm(xy, axis=-1)
            theta = self.lens.unbend(bent)
            scale = np.where(bent > 1e-12, np.sin(theta) / np.where(bent > 1e-12, bent, 1.0), 1.0)
            return np.concatenate([xy * scale[..., None], np.cos(theta)[..., None]], axis=-1)
        xy = self.lens.undistort(xy)
        rays = np.concatenate([xy, np.ones_like(xy[..., :1])], axis=-1)
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)

    def rays(self) -> Float[np.ndarray, "h w 3"]:
        """The unit direction through every pixel centre; NaN where the lens model has no ray."""
        v, u = np.mgrid[0 : self.height, 0 : self.width].astype(np.float64)
        return self.unproject(np.stack([u, v], axis=-1))

    def cropped(self, left: int, top: int, width: int, height: int) -> Intrinsics:
        """For a part of the same picture, given by its upper left pixel and its size in pixels."""
        return replace(self, width=width, height=height, cx=self.cx - left, cy=self.cy - top)

    def squared(self) -> Intrinsics:
        """For the square in the middle of the same picture (`middle_square`); of a square picture the same."""
        left, top, edge = middle_square(self.width, self.height)
        return self if self.width == self.height else self.cropped(left, top, edge, edge)

    def resized(self, width: int, height: int) -> Intrinsics:
        """For the same picture resampled to another size (edges stay edges)."""
        sx, sy = width / self.width, height / self.height
        return Intrinsics(
            width, height, self.fx * sx, self.fy * sy, (self.cx + 0.5) * sx - 0.5, (self.cy + 0.5) * sy - 0.5, self.lens
        )


def middle_square(width: int, height: int) -> tuple[int, int, int]:
    """Left, top and edge, in pixels, of the largest square in the middle of a picture of that size."""
    edge = min(width, height)
    return (width - edge) // 2, (height - edge) // 2, edge


def _newton_inverse(
    distort: Callable[[np.ndarray], np.ndarray], target: Float[np.ndarray, "*n 2"]
) -> Float[np.ndarray, "*n 2"]:
    target = np.asarray(target, dtype=np.float64)
    xy, h = target.copy(), 1e-6
    for _ in range(_UNDISTORT_ITERATIONS):
        residual = distort(xy) - target
        if np.abs(residual).max(initial=0.0) < _UNDISTORT_TOLERANCE:
            break
        dx = (distort(xy + [h, 0.0]) - distort(xy - [h, 0.0])) / (2 * h)
        dy = (distort(xy + [0.0, h]) - distort(xy - [0.0, h])) / (2 * h)
        determinant = dx[..., 0] * dy[..., 1] - dx[..., 1] * dy[..., 0]
        determinant = np.where(np.abs(determinant) < 1e-9, 1e-9, determinant)
        step = (
            np.stack(
                [
                    dy[..., 1] * residual[..., 0] - dy[..., 0] * residual[..., 1],
                    dx[..., 0] * residual[..., 1] - dx[..., 1] * residual[..., 0],
                ],
                axis=-1,
            )
            / determinant[..., None]
        )
        xy = xy - np.clip(step, -0.5, 0.5)
    off = np.abs(distort(xy) - target).max(axis=-1) > 1e-6
    # On the far side of the fold the model maps outwards to inwards: such a root is not a lens.
    folded = (xy * target).sum(axis=-1) < 0
    return np.where((off | folded)[..., None], np.nan, xy)
