"""Views that are almost the same: what a clean test must not find in the training."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from naris.core.pose import Pose
from naris.errors import PoseError
from naris.render.directions import tilted

NEIGHBOUR_MM = 2.0
NEIGHBOUR_DEG = 15.0
_TURNS = 6
_PAST_DEG, _SPREAD_DEG = 0.5, 6.0


def turned_away(of: Pose, views: Pose, rng: np.random.Generator) -> Pose:
    """Cameras near one of M unseen views, turned until they look just past it; the others, and all positions, stay.

    Were such cameras left out, nobody would ever stand where an unseen view is, and a network would learn just that:
    its poses and regions would avoid the very places that it is tested at. Turned somewhere else altogether, they
    would leave a gap in the directions that it has to bridge: so they stand close around it, on every side.

    Args:
        of: (M,) the unseen views.
        views: (N,) cameras, near them or not. A few may still be near in the end, where unseen views are many.
        rng: for how far and to which side.
    """
    matrix = views.matrix.copy()
    near = np.flatnonzero(neighbours(of, views))
    for turn in range(_TURNS):
        if not len(near):
            break
        forward, position_mm = views.forward[near], views.position_mm[near]
        apart_mm = np.linalg.norm(position_mm[:, None] - of.position_mm[None], axis=-1)
        nearest = np.where(apart_mm < NEIGHBOUR_MM, forward @ of.forward.T, -np.inf).argmax(axis=1)
        past_deg = NEIGHBOUR_DEG + _PAST_DEG * (1 + turn) + _SPREAD_DEG * np.abs(rng.standard_normal(len(near)))
        goal = tilted(of.forward[nearest], np.deg2rad(past_deg), rng)
        matrix[near, :3, :3] = _least_turn(forward, goal) @ views.rotation[near]
        near = near[neighbours(of, Pose(matrix[near], views.target, views.source))]
    return Pose(matrix, views.target, views.source)


def _least_turn(start: Float[np.ndarray, "n 3"], goal: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """The smallest rotations that take unit vectors to others."""
    axis = np.cross(start, goal)
    sine = np.linalg.norm(axis, axis=1)
    angle_rad = np.arctan2(sine, (start * goal).sum(axis=1))
    return Rotation.from_rotvec(axis * (angle_rad / np.maximum(sine, 1e-12))[:, None]).as_matrix()


def neighbours(of: Pose, views: Pose) -> Bool[np.ndarray, "n"]:
    """Which of N views have one of M others less than 2 mm and less than 15° (between viewing directions) off.

    The angle between the full orientations is never smaller than that between the viewing directions, so views without
    a neighbour have none in that sense either.

    Args:
        of: (M,) the others.
        views: (N,).

    Raises:
        PoseError: if the poses are in different frames.
    """
    if of.target != views.target:
        raise PoseError(f"poses in the frame {of.target!r}", f"{views.target!r}", "bring them to one frame")
    apart_mm = np.linalg.norm(views.position_mm[:, None] - of.position_mm[None], axis=-1)
    cosine = views.forward @ of.forward.T
    return ((apart_mm < NEIGHBOUR_MM) & (cosine > np.cos(np.deg2rad(NEIGHBOUR_DEG)))).any(axis=1)
