"""What structure from motion would make of a simulated shot: a few cameras side by side, and points that they see."""

from __future__ import annotations

import numpy as np

from naris.anatomy.distance import signed_distance
from naris.core.camera import Intrinsics
from naris.core.pose import CAMERA, Pose
from naris.register.sfm.reconstruction import WORLD, Reconstruction, View
from naris.render.scene import Scene, render

SHOT = Intrinsics.from_vertical_fov(96, 80, 80.0)
_SEEN = 0.02


def reconstructed(anatomy, pose, seed, *, views=6, points=500, noise_mm=0.2, step_mm=1.5, turn_deg=6.0):
    """A reconstruction of a shot that begins at `pose`, in a unit and a world of its own, and mm per unit of it."""
    rng = np.random.default_rng(seed)
    anatomy_T_camera = _shot(anatomy, pose, rng, views, step_mm, np.deg2rad(turn_deg))
    depth = render(Scene(anatomy), anatomy_T_camera, SHOT, want=("depth",)).depth_mm
    at = _on_walls(anatomy_T_camera, depth, points, rng)
    seen = [_sees(anatomy_T_camera[i], depth[i], at) for i in range(views)]
    mm_per_unit = float(np.exp(rng.uniform(np.log(0.1), np.log(30.0))))
    world_T_anatomy = Pose.exp(np.concatenate([rng.normal(size=3) * 20, rng.normal(size=3)]), WORLD, anatomy.frame)
    world_T_camera = world_T_anatomy @ anatomy_T_camera
    camera_T_world = Pose.of(world_T_camera.rotation, world_T_camera.position_mm / mm_per_unit, WORLD, CAMERA).inverse()
    noisy = world_T_anatomy.apply(at + noise_mm * rng.standard_normal(at.shape)) / mm_per_unit
    made = tuple(
        View(f"shot {i:02d}.png", camera_T_world[i], SHOT, np.flatnonzero(mask)) for i, mask in enumerate(seen)
    )
    return Reconstruction(made, noisy), mm_per_unit


def _shot(anatomy, pose, rng, count, step_mm, turn_rad):
    distance = signed_distance(anatomy, 0.5)
    steps = [np.zeros(6)]
    while len(steps) < count:
        step = np.concatenate([step_mm * rng.standard_normal(3), turn_rad * rng.standard_normal(3)])
        if distance((pose @ Pose.exp(step, CAMERA, CAMERA)).position_mm) > 0.6:
            steps.append(step)
    return pose @ Pose.exp(np.array(steps), CAMERA, CAMERA)


def _on_walls(poses, depth, count, rng):
    rays = SHOT.rays() / SHOT.rays()[..., 2:]
    chosen = rng.permutation(np.flatnonzero(depth.ravel() > 0))[:count]
    view, pixel = np.divmod(chosen, depth[0].size)
    inside = rays.reshape(-1, 3)[pixel] * depth.ravel()[chosen, None]
    return np.stack([poses[v].apply(p) for v, p in zip(view, inside, strict=True)])


def _sees(pose, depth, points):
    inside = pose.inverse().apply(points)
    pixels, front = SHOT.project(inside)
    column, row = np.clip(np.rint(np.nan_to_num(pixels)).astype(int).T, 0, [[SHOT.width - 1], [SHOT.height - 1]])
    return front & (np.abs(depth[row, column] / inside[:, 2] - 1) < _SEEN)
