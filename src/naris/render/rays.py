"""The rays of a camera, computed once for each set of intrinsics."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float32

from naris.core.camera import Intrinsics


@dataclass(frozen=True, eq=False)
class RayTable:
    """Rays through all pixel centres, row by row.

    Attributes:
        directions: (H·W, 3) unit, camera frame; straight ahead where the lens has no ray.
        exists: (H·W,) whether the lens has a ray.
        pixel_rad: angle between neighbouring pixels in the middle of the picture.
    """

    directions: Float32[np.ndarray, "n 3"]
    exists: Bool[np.ndarray, "n"]
    pixel_rad: float


@lru_cache(maxsize=16)
def ray_table(intrinsics: Intrinsics) -> RayTable:
    """The rays of these intrinsics (kept for the last few)."""
    directions = intrinsics.rays().reshape(-1, 3)
    exists = np.isfinite(directions).all(axis=-1)
    directions = np.where(exists[:, None], directions, [0.0, 0.0, 1.0]).astype(np.float32)
    directions.setflags(write=False)
    exists.setflags(write=False)
    return RayTable(directions, exists, 1 / intrinsics.fy)
