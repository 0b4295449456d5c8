"""A region that somebody named: an answer elsewhere contradicts what was said, and is none."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

from naris.core.anatomy import RegionSet
from naris.core.results import Registration
from naris.register.astray import at_and_around
from naris.register.deformable.result import DeformableRegistration

Found = TypeVar("Found", Registration, DeformableRegistration)


def unless_elsewhere(found: Found, regions: RegionSet, name: str) -> Found:
    """A registration, or its refusal where the pose lies further than `BESIDE_MM` outside of the region.

    The search begins in that region alone, but where it ends is told by what was seen.

    Args:
        found: what was registered with the belief that the camera is there (`naris.register.starts.in_region`).
        regions: the set, of a shape that was estimated as it is carried along.
        name: of the region.
    """
    if found.anatomy_T_camera is None:
        return found
    labels = regions.label(at_and_around(found.best.position_mm))
    if regions.names.index(name) in labels:
        return found
    other = regions.names[labels[0]] if labels[0] >= 0 else "none of the regions"
    reason = f"the best pose is in {other}, not in {name} as was named: check the name, or go without a region"
    return replace(found, anatomy_T_camera=None, status="refused", reason=reason)
