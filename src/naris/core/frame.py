"""What a camera gives (`Frame`), and the same with the truth known (`Sample`)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, Int, UInt8

from naris.core.camera import Intrinsics
from naris.core.pose import Pose
from naris.errors import ImageError


@dataclass(frozen=True, eq=False)
class Frame:
    """One endoscopic picture.

    Attributes:
        image: (H, W, 3) uint8, RGB.
        intrinsics: of the camera, of the same size as the image.
        time_s: since the start of the video, or None for a still.
    """

    image: UInt8[np.ndarray, "h w 3"]
    intrinsics: Intrinsics
    time_s: float | None = None

    def __post_init__(self) -> None:
        expected = (self.intrinsics.height, self.intrinsics.width, 3)
        if self.image.shape != expected:
            raise ImageError(
                f"an RGB picture of shape {expected} to match its intrinsics",
                f"{self.image.shape}",
                "resize the picture or the intrinsics",
            )


@dataclass(frozen=True, eq=False)
class Sample:
    """A frame with its truth.

    Attributes:
        frame: what the camera saw.
        anatomy_T_camera: where it was.
        region: label in the region set of the data set.
        depth_mm: (H, W) z-depth, 0 where invalid; None if it was not kept.
    """

    frame: Frame
    anatomy_T_camera: Pose
    region: int
    depth_mm: Float32[np.ndarray, "h w"] | None = None
    normals: Float32[np.ndarray, "h w 3"] | None = None
    face_ids: Int[np.ndarray, "h w"] | None = None
