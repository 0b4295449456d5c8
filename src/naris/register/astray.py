"""Places where no camera can be: a pose that a picture has moved there is no answer."""

from __future__ import annotations

from dataclasses import replace

from naris.core.pose import Pose
from naris.core.results import Registration
from naris.register.map import RegistrationMap
from naris.register.starts import Belief

_LEAST_ROOM_MM = 0.3


def astray(at: RegistrationMap, belief: Belief, pose: Pose) -> str | None:
    """Where a camera would be that cannot be there, to follow "the pose is …"; None where one can be."""
    if float(at.distance(pose.position_mm)) < _LEAST_ROOM_MM:
        return "in a wall"
    if float(belief.chance(pose.position_mm[None])[0]) <= 0:
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
