"""A region that somebody named: an answer elsewhere contradicts what was said, and is none."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from naris.core.anatomy import RegionSet
from naris.core.results import Registration

BESIDE_MM = 2.0
"""So near to the region a pose may lie: no further than it may be off."""
_AROUND = np.array([axis for axis in np.ndindex(3, 3, 3) if axis != (1, 1, 1)], dtype=np.float64) - 1


def unless_elsewhere(found: Registration, regions: RegionSet, name: str) -> Registration:
    """A registration, or its refusal where the pose lies further than `BESIDE_MM` outside of the region.

    The search begins in that region alone, but where it ends is told by what was seen.

    Args:
        found: what was registered with the belief that the camera is there (`naris.register.starts.in_region`).
        regions: the set.
        name: of the region.
    """
    if found.anatomy_T_camera is None:
        return found
    here = found.best.position_mm
    around = here + BESIDE_MM * _AROUND / np.linalg.norm(_AROUND, axis=1, keepdims=True)
    label = int(regions.label(here))
    if regions.names.index(name) in (label, *regions.label(around)):
        return found
    other = regions.names[label] if label >= 0 else "none of the regions"
    reason = f"the best pose is in {other}, not in {name} as was named: check the name, or go without a region"
    return replace(found, anatomy_T_camera=None, status="refused", reason=reason)
