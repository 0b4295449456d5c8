"""What a registration of a trial begins with, ours or another's: what is seen, what is believed, how much is tried."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Literal, NamedTuple

import numpy as np

from naris.bench.trials import FREE_POINTS, Noise, Trial, neighbours_of
from naris.core.pose import CAMERA, Pose
from naris.register.map import RegistrationMap
from naris.register.observation import Observation, together
from naris.register.register import FROM_POSE, RegisterConfig
from naris.register.starts import NOTHING, Belief, in_region, near

Start = Literal["region", "none", "pose", "views3"]
SOLVED_POINTS = 400
"""Of one solve that is timed."""
_NEAR_MM, _NEAR_RAD = 2.0, np.deg2rad(10.0)
_NEAR_COVARIANCE = np.diag([(_NEAR_MM / 2) ** 2] * 3 + [(_NEAR_RAD / 2) ** 2] * 3)


class Problem(NamedTuple):
    """`look` gives what is seen: to make it of ranges belongs to what a registration costs."""

    look: Callable[[], Observation]
    belief: Belief
    config: RegisterConfig


def problem(at: RegistrationMap, trial: Trial, noise: Noise, start: Start, seed: int) -> Problem:
    """A trial from a start.

    Args:
        at: the anatomy.
        trial: one view; more are made beside it for `views3`.
        noise: of what is seen.
        start: the true region; nothing; a pose within 2 mm and 10° of the truth; or three views and nothing else.
        seed: of what is drawn: the pose that is told, views beside the first, starts.
    """
    look, config = partial(trial.observation, noise), RegisterConfig(seed=seed)
    if start == "region":
        regions = at.anatomy.region_set()
        name = regions.names[int(regions.label(trial.anatomy_T_camera.position_mm))]
        return Problem(look, in_region(regions, name), config)
    if start == "pose":
        return Problem(look, near(told_pose(trial, seed), _NEAR_COVARIANCE[None]), FROM_POSE)
    if start == "views3":
        views, rig_T_camera = neighbours_of(at.anatomy, trial, 2, seed)
        return Problem(partial(several, views, rig_T_camera, noise), NOTHING, config)
    return Problem(look, NOTHING, config)


def told_pose(trial: Trial, seed: int) -> Pose:
    """The pose near the truth that a trial from a pose begins with."""
    return near_truth(trial, np.random.default_rng([seed, 6]))


def near_truth(trial: Trial, rng: np.random.Generator) -> Pose:
    """A pose at random within 2 mm and 10° of the truth."""
    step = rng.standard_normal((2, 3))
    step *= (rng.random((2, 1)) * np.array([[_NEAR_MM], [_NEAR_RAD]])) / np.linalg.norm(step, axis=1, keepdims=True)
    return trial.anatomy_T_camera @ Pose.exp(step.ravel(), CAMERA, CAMERA)


def several(views: Sequence[Trial], rig_T_camera: Pose, noise: Noise) -> Observation:
    """Views as one observation; those of noise c and e share the scale of the first, as the positions do.

    Args:
        views: with the truth, in mm.
        rig_T_camera: (V,) in mm.
        noise: of all.
    """
    if noise not in ("c", FREE_POINTS):
        return together([one.observation(noise) for one in views], rig_T_camera)
    scale = views[0].scale
    alike = [replace(one, ranges={"c": scale * one.ranges["b"]}, scale=scale) for one in views]
    poses = Pose.of(rig_T_camera.rotation, scale * rig_T_camera.position_mm, CAMERA, CAMERA)
    return together([one.observation(noise) for one in alike], poses)
