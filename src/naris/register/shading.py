"""Where there is a picture: a pose moved until our own picture from there is shaded as it is.

Light at the camera falls off with the distance and with the slant of a wall, so brightness tells shape all over the
frame, where edges tell it in few places. The walls are rendered, small and of one colour, and compared with the
frame by the logarithm of the red channel, in which blood and vessels are faintest. What light, lens and mucosa add is a
factor and a smooth field that are estimated with the pose; what they do not explain (vessels, highlights, mucus) is
held off by a robust cost. Derivatives by the pose are differences of rendered pictures, which know what becomes hidden,
as no derivative of a surface does. Direct alignment is old (Lucas and Kanade, IJCAI 1981; Engel et al., PAMI 2018); of
endoscopy with virtual views it is that of Deligianni et al. (IEEE TMI 2004), who compare shading as well.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from naris.core.camera import Intrinsics
from naris.core.pose import CAMERA, Pose
from naris.core.results import Registration
from naris.errors import ImageError
from naris.register.contour import black_border, check_size
from naris.render.appearance import Appearance
from naris.render.instrument import Light, Sensor
from naris.render.material import Uniform
from naris.render.scene import Scene, render

_PX = 96  # of the longer side: what is smaller than a pixel of that is texture, not shape
_LEVELS = ((4.0, 8), (1.5, 6))  # blur in pixels, and steps
_DARK = 8.0  # grey levels, added before the logarithm: noise is no contrast
_LEAST_SHARE = 1e-3  # deep in a border, where nothing counts
_WIDTH = 0.25  # of the logarithm: a residual of that size counts half
_PIXELS = 300.0  # neighbours err alike, and where mucosa is pale: the picture counts as so many pixels by themselves
_CONTRAST_SD, _LEVEL_SD, _FIELD_SD = 1.0, 3.0, 0.5
_NUDGE = np.array([0.15, 0.15, 0.15, 0.01, 0.01, 0.01])  # mm and rad, either way: well above the size of a pixel
_LEAST_CONTRAST = 0.3
_STRANGE = 45.0  # what a frame of another place costs, or more; the right one 5 to 20
_ROUNDS = 4
_DAMPING, _TRIES = 1e-2, 3

BARE = Appearance(
    Uniform((0.8, 0.5, 0.44)),
    Light(diffuse=(1.0, 0.97, 0.92), attenuation=(1.0, 0.0, 0.05), exponent=1.0, wrap=(0.25, 0.10, 0.08)),
    sensor=Sensor(auto_exposure=1.0, meter_quantile=0.92, target=0.5, gamma=2.2, shoulder=0.6),
)
"""Walls of one colour with a light at the lens: what an endoscope's picture is without its mucosa."""


class Shaded(NamedTuple):
    """A pose whose picture was compared with a frame.

    Attributes:
        pose: `anatomy_T_camera`.
        cost: −2 log likelihood of the frame there, but for a constant; at most `_PIXELS`.
        precision: (6, 6) what the frame tells of the twist in the camera (mm, rad), light and mucosa left free.
        contrast: the factor on the logarithm of our picture; 1 where tone curves and falloff are alike.
    """

    pose: Pose
    cost: float
    precision: Float[np.ndarray, "6 6"]
    contrast: float


@dataclass(frozen=True, eq=False)
class Reshaded:
    """What became of a registration.

    Attributes:
        registration: with pose and covariance as they are with the frame; as it was where that is not shaded as the
            walls there are, or no pose near is better.
        used: whether it is.
        moved_mm, moved_deg: from the pose without it.
        cost: of the frame before and after, `Shaded.cost`.
    """

    registration: Registration
    used: bool
    moved_mm: float
    moved_deg: float
    cost: tuple[float, float]


def reshaded(scene: Scene, found: Registration, frame: UInt8[np.ndarray, "h w 3"], intrinsics: Intrinsics) -> Reshaded:
    """Move the best pose of a registration until our picture from there is shaded as the frame is.

    What was decided, and the probability, stay as they were: they were fitted without pictures.

    Args:
        scene: the anatomy that was registered to.
        found: the registration of the camera that took the frame.
        frame: (H, W, 3) sRGB.
        intrinsics: of its camera; the size is that of the frame.

    Raises:
        ImageError: if frame and intrinsics differ in size, or hardly anything of the frame is not black.
    """
    shading = Shading(scene, frame, intrinsics)
    information = np.linalg.inv(found.covariance)
    before = shading.cost(found.best)
    made = shading.refined(found.best, information)
    by = (found.best.inverse() @ made.pose).log()
    if made.contrast < _LEAST_CONTRAST or made.cost > _STRANGE or made.cost + by @ information @ by > before:
        return Reshaded(found, False, 0.0, 0.0, (before, made.cost))
    moved = replace(
        found,
        best=made.pose,
        anatomy_T_camera=None if found.anatomy_T_camera is None else made.pose,
        covariance=np.linalg.inv(made.precision + information),
    )
    off_mm, off_deg = float(np.linalg.norm(by[:3])), float(np.rad2deg(np.linalg.norm(by[3:])))
    return Reshaded(moved, True, off_mm, off_deg, (before, made.cost))


class _Blur(NamedTuple):
    """A blur of what is shown (H, W), 1 or 0; `share` of it is what each pixel gets from there."""

    px: float
    shown: Float[np.ndarray, "h w"]
    share: Float[np.ndarray, "h w"]

    @staticmethod
    def of(px: float, shown: Bool[np.ndarray, "h w"]) -> _Blur:
        """One that brings nothing of a black border into the picture beside it."""
        one = shown.astype(np.float32)
        return _Blur(px, one, np.maximum(cv2.GaussianBlur(one, (0, 0), px), _LEAST_SHARE))

    def log(self, picture: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "n"]:
        """The logarithm of red, blurred."""
        red = np.log(picture[..., 0].astype(np.float32) + _DARK)
        return (cv2.GaussianBlur(red * self.shown, (0, 0), self.px) / self.share).ravel().astype(np.float64)


class _Level(NamedTuple):
    """The frame at a blur: its logarithm (N,) and how much each pixel counts (N,)."""

    blur: _Blur
    steps: int
    picture: Float[np.ndarray, "n"]
    counts: Float[np.ndarray, "n"]


class _Fit(NamedTuple):
    """How our picture at a pose is made to look like the frame."""

    factors: Float[np.ndarray, "f"]
    residual: Float[np.ndarray, "n"]
    weight: Float[np.ndarray, "n"]
    cost: float


class Shading:
    """A frame, ready to be compared with what our camera sees in an anatomy.

    Args:
        scene: the anatomy.
        frame: (H, W, 3) sRGB.
        intrinsics: of its camera; the size is that of the frame.

    Raises:
        ImageError: if frame and intrinsics differ in size, or hardly anything of the frame is not black.
    """

    def __init__(self, scene: Scene, frame: UInt8[np.ndarray, "h w 3"], intrinsics: Intrinsics) -> None:
        check_size(frame, intrinsics)
        shrink = min(_PX / max(intrinsics.width, intrinsics.height), 1.0)
        self._camera = intrinsics.resized(*(max(round(shrink * n), 8) for n in (intrinsics.width, intrinsics.height)))
        size = (self._camera.width, self._camera.height)
        small = cv2.resize(frame, size, interpolation=cv2.INTER_AREA)
        shown = cv2.erode((~black_border(small)).astype(np.uint8), np.ones((5, 5), np.uint8), borderValue=1) > 0
        if shown.mean() < 0.1:
            raise ImageError("a frame that shows something", f"{1 - shown.mean():.0%} of it black", "give another")
        self._scene = scene
        self._fields = _fields(*size)
        self._levels = [_level(small, shown, *each) for each in _LEVELS]

    def cost(self, pose: Pose) -> float:
        """Of the frame at a pose, `Shaded.cost`."""
        level = self._levels[-1]
        return self._fit(level, self._pictures(pose.reshape(1), level)[0]).cost

    def refined(self, pose: Pose, information: Float[np.ndarray, "6 6"]) -> Shaded:
        """Move a pose until our picture is shaded as the frame.

        Args:
            pose: `anatomy_T_camera`.
            information: (6, 6) the inverse covariance of its twist (mm, rad), which holds it where it is.
        """
        here = pose
        for level in self._levels[:-1]:
            here, _, _ = self._aligned(level, pose, here, information)
        here, fit, precision = self._aligned(self._levels[-1], pose, here, information)
        return Shaded(here, fit.cost, precision, float(fit.factors[0]))

    def _aligned(
        self, level: _Level, start: Pose, here: Pose, information: Float[np.ndarray, "6 6"]
    ) -> tuple[Pose, _Fit, Float[np.ndarray, "6 6"]]:
        """Levenberg–Marquardt at one blur; also what the frame alone tells of the pose."""
        ours, slope = self._linear(level, here)
        fit, damping = self._fit(level, ours), _DAMPING
        for _ in range(level.steps):
            matrix, right = self._equations(level, ours, slope, fit)
            off = (start.inverse() @ here).log()
            matrix[:6, :6] += information
            right[:6] -= information @ off
            for _ in range(_TRIES):
                step = np.linalg.solve(matrix + damping * np.diag(np.diag(matrix)), right)[:6]
                there = here @ Pose.exp(step, CAMERA, CAMERA)
                beyond = self._fit(level, self._pictures(there.reshape(1), level)[0])
                off_there = (start.inverse() @ there).log()
                if beyond.cost + off_there @ information @ off_there < fit.cost + off @ information @ off:
                    break
                damping *= 6
            else:
                break
            here, fit, damping = there, beyond, 0.3 * damping
            ours, slope = self._linear(level, here)
        matrix, _ = self._equations(level, ours, slope, fit)
        free = matrix[:6, 6:] @ np.linalg.solve(matrix[6:, 6:], matrix[6:, :6])
        return here, fit, matrix[:6, :6] - free

    def _pictures(self, poses: Pose, level: _Level) -> Float[np.ndarray, "m n"]:
        """The logarithms of our pictures."""
        rgb = render(self._scene, poses, self._camera, BARE, want=("rgb",), threads=1).rgb
        if rgb is None:
            raise AssertionError("a rendering without the channel that was asked for")
        return np.stack([level.blur.log(one) for one in rgb])

    def _linear(self, level: _Level, pose: Pose) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n 6"]]:
        """Our picture and its derivatives by a twist."""
        nudges = np.concatenate([np.zeros((1, 6)), np.diag(_NUDGE), -np.diag(_NUDGE)])
        made = self._pictures(pose.reshape(1) @ Pose.exp(nudges, CAMERA, CAMERA), level)
        return made[0], ((made[1:7] - made[7:]) / (2 * _NUDGE[:, None])).T

    def _fit(self, level: _Level, ours: Float[np.ndarray, "n"]) -> _Fit:
        """The factor, level and smooth field that make our picture most like the frame, by reweighted least squares."""
        columns, weight = np.column_stack([ours, self._fields]), level.counts
        for _ in range(_ROUNDS):
            square = columns.T @ (weight[:, None] * columns) / _WIDTH**2 + np.diag(_PRIOR)
            factors = np.linalg.solve(square, columns.T @ (weight * level.picture) / _WIDTH**2 + _PRIOR * _MIDDLE)
            residual = level.picture - columns @ factors
            off = np.square(residual / _WIDTH)
            weight = level.counts / np.square(1 + off)
        cost = float(level.counts @ (off / (1 + off)) + _PRIOR @ np.square(factors - _MIDDLE))
        return _Fit(factors, residual, weight, cost)

    def _equations(
        self, level: _Level, ours: Float[np.ndarray, "n"], slope: Float[np.ndarray, "n 6"], fit: _Fit
    ) -> tuple[Float[np.ndarray, "u u"], Float[np.ndarray, "u"]]:
        """Normal equations of the pose, then of the factors."""
        columns = np.column_stack([fit.factors[0] * slope, ours, self._fields])
        weighted = columns.T * (fit.weight / _WIDTH**2)
        matrix = weighted @ columns
        matrix[6:, 6:] += np.diag(_PRIOR)
        return matrix, weighted @ fit.residual


_FIELDS = 6
_PRIOR = 1 / np.square(np.array([_CONTRAST_SD, _LEVEL_SD] + [_FIELD_SD] * (_FIELDS - 1)))
_MIDDLE = np.array([1.0] + [0.0] * _FIELDS)


def _fields(width: int, height: int) -> Float[np.ndarray, "n f"]:
    """Polynomials up to the second degree over the picture: a level, and what light, lens and mucosa change slowly."""
    y, x = np.meshgrid(np.linspace(-1, 1, height), np.linspace(-1, 1, width), indexing="ij")
    return np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=-1).reshape(-1, _FIELDS)


def _level(small: UInt8[np.ndarray, "h w 3"], shown: Bool[np.ndarray, "h w"], blur_px: float, steps: int) -> _Level:
    blur = _Blur.of(blur_px, shown)
    return _Level(blur, steps, blur.log(small), _PIXELS * shown.ravel() / shown.sum())
