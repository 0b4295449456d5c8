"""Region sets: the paper's slabs, region sets on disk, and the regions of viewpoints."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int

from naris.core.anatomy import RegionSet, SlabRegions
from naris.core.pose import Pose
from naris.errors import RegionError

PAPER_BORDERS_MM = (-30.0, -15.0, 0.0)
PAPER_NAMES = ("slab 1 (anterior)", "slab 2", "slab 3", "slab 4 (posterior)")


def paper_slabs(frame: str) -> SlabRegions:
    """The four slabs of Sinha et al. 2018 in a frame whose y runs from the nostril to the nasopharynx.

    y ≤ −30, −30 < y ≤ −15, −15 < y ≤ 0 and y > 0, in mm, of the camera's position.
    """
    return SlabRegions("paper", PAPER_NAMES, frame, axis=1, borders_mm=PAPER_BORDERS_MM)


PAPER_SLABS = paper_slabs("mean")


def region_of_viewpoints(regions: RegionSet, anatomy_T_camera: Pose) -> Int[np.ndarray, "*batch"]:
    """The region that each camera stands in (`NOWHERE` outside all of them).

    Raises:
        RegionError: if the poses and the regions are in different frames.
    """
    if anatomy_T_camera.target != regions.frame:
        raise RegionError(
            f"poses in the frame {regions.frame!r} of the region set {regions.name!r}",
            f"poses in {anatomy_T_camera.target!r}",
            "bring them to one frame",
        )
    return regions.label(anatomy_T_camera.position_mm)
