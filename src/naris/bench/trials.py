"""Registration trials: poses inside an anatomy and what a camera there sees, with four kinds of noise.

The frozen trials lie in the mean nose; others of the same kind are drawn here. A camera has 64 × 64 rays over 80°, at
least 1 mm of room and a median depth of 3 mm, looks up to 90° off the way inwards and is rolled by up to 30°.

a: clean. b: ranges with a smooth relative error of 5 % and 0.3 mm each. c: b times an unknown scale of 0.5 to 2.
d: 300 to 600 points with 0.5 mm in every direction, a tenth of them anywhere along their rays. Beside these four
e: d times the scale of c.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, cast

import numpy as np
from jaxtyping import Float, UInt8
from scipy.ndimage import gaussian_filter

from naris.anatomy.distance import signed_distance
from naris.anatomy.read import read_surface
from naris.core.anatomy import Anatomy, Enclosed
from naris.core.camera import Intrinsics
from naris.core.pose import CAMERA, Pose, stack
from naris.register.directions import rotations
from naris.register.map import registration_map
from naris.register.noise import KNOWN, UNKNOWN, DepthNoise, PointNoise
from naris.register.observation import Observation, from_points, from_ranges
from naris.render.appearance import UNSEEN_APPEARANCE, Appearance
from naris.render.scene import Scene, render
from naris.render.viewpoints import sees_ahead

FROZEN, MEAN = "registration-trials/trials.npz", "mean-nose/ASR.ply"
Noise = Literal["a", "b", "c", "d", "e"]
NOISES: tuple[Noise, ...] = ("a", "b", "c", "d")
FREE_POINTS: Noise = "e"
PIXELS, FOV_DEG = 64, 80.0
CAMERA_OF_TRIALS = Intrinsics.from_vertical_fov(PIXELS, PIXELS, FOV_DEG)
FRAME_PX = 300
_ROOM_MM, _TILT_DEG, _ROLL_DEG = 1.0, 90.0, 30.0
_LEAST_DEPTH_MM = 3.0  # that of the frozen trials: of a nearer wall one sees nothing but wall
_SMOOTH, _SMOOTH_PX, _PIXEL_MM = 0.05, 5.25, 0.3
_SCALES = (0.5, 2.0)
POINT_MM = 0.5
_POINTS, _OUTLIERS = (300, 600), 0.1
_LEAST_RANGE_MM = 0.2
_TRIES = 100


@dataclass(frozen=True, eq=False)
class Trial:
    """One pose and what is seen from it.

    Attributes:
        anatomy_T_camera: the truth.
        rays: (64, 64, 3) unit, in the camera.
        ranges: by noise a, b and c, (64, 64) along the rays; c in its own unit.
        scale: what the ranges of c were multiplied by.
        points: (N, 3) of noise d, in the camera.
    """

    anatomy_T_camera: Pose
    rays: Float[np.ndarray, "64 64 3"]
    ranges: dict[str, Float[np.ndarray, "64 64"]]
    scale: float
    points: Float[np.ndarray, "n 3"]

    def observation(self, noise: Noise) -> Observation:
        """What the registration is given; the noise is stated, the scale of c and e is not."""
        if noise == "d":
            return from_points(self.points, PointNoise(POINT_MM, _OUTLIERS))
        if noise == FREE_POINTS:
            return from_points(self.scale * self.points, PointNoise(self.scale * POINT_MM, _OUTLIERS), UNKNOWN)
        if noise == "a":
            return from_ranges(self.ranges["a"], self.rays, DepthNoise(smooth=0.0, pixel_mm=0.05))
        pixel = _PIXEL_MM * (self.scale if noise == "c" else 1.0)
        return from_ranges(
            self.ranges[noise], self.rays, DepthNoise(pixel_mm=pixel), UNKNOWN if noise == "c" else KNOWN
        )

    def log_scale(self, noise: Noise) -> float:
        """The logarithm of the true factor to mm."""
        return -float(np.log(self.scale)) if noise in ("c", FREE_POINTS) else 0.0


def has_frozen(folder: Path) -> bool:
    """Whether the frozen trials and the nose they are in are given."""
    return (folder / FROZEN).is_file() and (folder / MEAN).is_file()


def frozen_setting(folder: Path) -> tuple[Anatomy, list[Trial]]:
    """The mean nose and the frozen trials in it."""
    # Their poses lie inside the closed surface itself, not in the air between its walls.
    mean = read_surface(folder / MEAN).with_(airspace=Enclosed(), passages=())
    return mean, frozen_trials(folder / FROZEN, mean.frame)


def frozen_trials(file: Path, frame: str) -> list[Trial]:
    """Those in `trials.npz`."""
    with np.load(file) as kept:
        poses = Pose(kept["mean_T_camera"], frame, CAMERA)
        rays = kept["ray_direction"].astype(np.float64)
        points = kept["points_d"].astype(np.float64)
        ranges = {noise: kept[f"range_{noise}"].astype(np.float64) for noise in "abc"}
        return [
            Trial(
                poses[i],
                rays,
                {noise: values[i] for noise, values in ranges.items()},
                float(kept["scale_c"][i]),
                points[i][np.isfinite(points[i]).all(axis=1)],
            )
            for i in range(len(points))
        ]


def drawn_trials(anatomy: Anatomy, count: int, seed: int) -> list[Trial]:
    """Trials of the same kind in any anatomy, each region of its first set equally often."""
    rng = np.random.default_rng([seed, 4])
    poses = _poses(anatomy, count, rng)
    return list(trials_at(anatomy, poses, rng))


def neighbours_of(anatomy: Anatomy, trial: Trial, count: int, seed: int) -> tuple[list[Trial], Pose]:
    """More views a few mm and degrees beside that of a trial, and `rig_T_camera` of all, that of the trial first."""
    rng = np.random.default_rng([seed, 5])
    distance = signed_distance(anatomy, 0.5)
    steps = [np.zeros(6)]
    while len(steps) <= count:
        step = np.concatenate([2.0 * rng.standard_normal(3), np.deg2rad(8.0) * rng.standard_normal(3)])
        moved = trial.anatomy_T_camera @ Pose.exp(step, CAMERA, CAMERA)
        if distance(moved.position_mm) > 0.8:
            steps.append(step)
    rig_T_camera = Pose.exp(np.array(steps), CAMERA, CAMERA)
    rest = list(trials_at(anatomy, trial.anatomy_T_camera @ rig_T_camera[1:], rng))
    return [trial, *rest], rig_T_camera


def frames(anatomy: Anatomy, trials: Sequence[Trial], seed: int) -> UInt8[np.ndarray, "n h w 3"]:
    """What the camera of each trial sees, under looks that no training had."""
    rng = np.random.default_rng([seed, 8])
    looks = [UNSEEN_APPEARANCE.sample(rng) for _ in trials]
    seeds = rng.integers(2**31, size=len(trials))
    poses = stack([trial.anatomy_T_camera for trial in trials])
    camera = CAMERA_OF_TRIALS.resized(FRAME_PX, FRAME_PX)
    return cast(np.ndarray, render(Scene(anatomy), poses, camera, looks, want=("rgb",), seeds=seeds).rgb)


def frame(
    scene: Scene, trial: Trial, camera: Intrinsics, rng: np.random.Generator, look: Appearance | None = None
) -> UInt8[np.ndarray, "h w 3"]:
    """What another camera sees where that of the trial is; if no look is given, under one that no training had."""
    look, seed = look or UNSEEN_APPEARANCE.sample(rng), rng.integers(2**31, size=1)
    poses = trial.anatomy_T_camera.reshape(1)
    return cast(np.ndarray, render(scene, poses, camera, [look], want=("rgb",), seeds=seed).rgb)[0]


def _poses(anatomy: Anatomy, count: int, rng: np.random.Generator) -> Pose:
    at = registration_map(anatomy)
    places = at.places_mm[at.distance(at.places_mm) >= _ROOM_MM]
    label = anatomy.region_set().label(places)
    names = np.unique(label[label >= 0])
    wanted = names[np.arange(count) % len(names)]
    turns, scene = rotations(at.inward, _TILT_DEG, _ROLL_DEG, 5.0), Scene(anatomy)
    chosen = np.zeros((count, 4, 4))
    left = np.arange(count)
    for _ in range(_TRIES):
        place = np.stack([places[rng.choice(np.flatnonzero(label == k))] for k in wanted[left]])
        poses = Pose.of(turns[rng.integers(len(turns), size=len(left))], place, anatomy.frame, CAMERA)
        chosen[left] = poses.matrix
        left = left[~sees_ahead(scene, poses, _LEAST_DEPTH_MM)]
        if not len(left):
            break
    return Pose(chosen, anatomy.frame, CAMERA)


def trials_at(anatomy: Anatomy, poses: Pose, rng: np.random.Generator) -> Iterator[Trial]:
    """What cameras at (N,) poses `anatomy_T_camera` see, with all kinds of noise."""
    rays = CAMERA_OF_TRIALS.rays()
    depth = render(Scene(anatomy), poses, CAMERA_OF_TRIALS, want=("depth",)).depth_mm
    if depth is None:
        return
    for i, clean in enumerate(depth / rays[..., 2]):
        field = gaussian_filter(rng.standard_normal(clean.shape), _SMOOTH_PX, mode="reflect")
        field = _SMOOTH * (field - field.mean()) / field.std()
        noisy = clean * (1 + field) + _PIXEL_MM * rng.standard_normal(clean.shape)
        noisy = np.where(clean > 0, np.maximum(noisy, _LEAST_RANGE_MM), np.nan)
        scale = float(np.exp(rng.uniform(*np.log(_SCALES))))
        yield Trial(
            poses[i],
            rays,
            {"a": np.where(clean > 0, clean, np.nan), "b": noisy, "c": scale * noisy},
            scale,
            _points(clean, rays, rng),
        )


def _points(
    clean: Float[np.ndarray, "h w"], rays: Float[np.ndarray, "h w 3"], rng: np.random.Generator
) -> Float[np.ndarray, "n 3"]:
    seen = np.flatnonzero(clean.ravel() > 0)
    chosen = rng.choice(seen, min(int(rng.integers(*_POINTS)), len(seen)), replace=False)
    ranges, ways = clean.ravel()[chosen], rays.reshape(-1, 3)[chosen]
    off = rng.random(len(chosen)) < _OUTLIERS
    ranges = np.where(off, ranges * rng.uniform(0.3, 3.0, len(chosen)), ranges)
    return np.asarray(ways * ranges[:, None] + POINT_MM * rng.standard_normal((len(chosen), 3)))
