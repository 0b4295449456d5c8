"""Places where no camera can be: a pose that a picture has moved there is no answer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from naris.core.pose import Pose
from naris.core.results import Registration
from naris.register.map import RegistrationMap
from naris.register.starts import Belief

BESIDE_MM = 2.0
"""So near to a region a pose may lie: no further than it may be off."""
_LEAST_ROOM_MM = 0.3
_AROUND = np.array([axis for axis in np.ndindex(3, 3, 3) if axis != (1, 1, 1)], dtype=np.float64) - 1


def at_and_around(place_mm: Float[np.ndarray, "3"]) -> Float[np.ndarray, "n 3"]:
    """A place, first, and places `BESIDE_MM` from it."""
    around = BESIDE_MM * _AROUND / np.linalg.norm(_AROUND, axis=1, keepdims=True)
    return place_mm + np.concatenate([np.zeros((1, 3)), around])


def astray(at: RegistrationMap, belief: Belief, pose: Pose) -> str | None:
    """Where a camera would be that cannot be there, to follow "the pose is …"; None where one can be.

    `BESIDE_MM` outside of a region that is believed in one can be.
    """
    if float(at.distance(pose.position_mm)) < _LEAST_ROOM_MM:
        return "in a wall"
    if not (belief.chance(at_and_around(pose.position_mm)) > 0).any():
        return "in none of the regions that were named"
    return None


def unless_astray(found: Registration, at: RegistrationMap, belief: Belief, by: str) -> Registration:
    """A registration that a picture moved, or its refusal where no camera can be.

    Args:
        found: with the moved pose.
        at, belief: as it was registered.
        by: what moved it, for the reason.
    """
    where = None if found.anatomy_T_camera is None else astray(at, belief, found.best)
    if where is None:
        return found
    reason = f"{by} moved the pose to where it is {where}: see that frame and depth are of one moment, or go without"
    return replace(found, anatomy_T_camera=None, status="refused", reason=reason)
