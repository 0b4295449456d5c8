"""What the stages hand to each other: predictions of a localizer, and what a run came to."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

from naris.core.pose import Pose
from naris.errors import RegionError


@dataclass(frozen=True, eq=False)
class Prediction:
    """What a localizer says about one frame.

    Attributes:
        region_set: the name of the region set that the model was made for.
        region_names: its K regions.
        log_probabilities: (K,) natural logarithms that sum to one as probabilities.
        hypotheses: camera poses `anatomy_T_camera`, best first, as a batch (M,); None from a model without a pose head.
        weights: (M,) of the hypotheses, summing to one.
        covariance: (M, 6, 6) of the twist of each hypothesis (mm, rad), in the camera frame.
        out_of_domain: 0 for a picture like those of the training, 1 for one that is surely not; None if not judged.
    """

    region_set: str
    region_names: tuple[str, ...]
    log_probabilities: Float[np.ndarray, "k"]
    hypotheses: Pose | None = None
    weights: Float[np.ndarray, "m"] | None = None
    covariance: Float[np.ndarray, "m 6 6"] | None = None
    out_of_domain: float | None = None

    def __post_init__(self) -> None:
        if self.log_probabilities.shape != (len(self.region_names),):
            raise RegionError(
                f"{len(self.region_names)} log-probabilities, one a region",
                f"{self.log_probabilities.shape}",
                "check the model",
            )

    @property
    def probabilities(self) -> Float[np.ndarray, "k"]:
        return np.exp(self.log_probabilities)

    @property
    def region(self) -> int:
        """The most probable region."""
        return int(np.argmax(self.log_probabilities))

    @property
    def region_name(self) -> str:
        return self.region_names[self.region]


@dataclass(frozen=True, eq=False)
class DepthEstimate:
    """How far away a network believes the walls of a picture to be.

    Attributes:
        rays: (H, W, 3) unit, in the camera.
        ranges_mm: (H, W) along them; NaN where the picture shows nothing.
        sd_log: (H, W) standard deviation of the logarithm of each range by itself.
        smooth: that of a relative error that varies slowly over the picture.
        reach_deg: how far it stays alike: the angle at which its correlation has fallen to exp(−1/2).
        scale_sd_log: standard deviation of the logarithm of a factor on all of them.
    """

    rays: Float[np.ndarray, "h w 3"]
    ranges_mm: Float[np.ndarray, "h w"]
    sd_log: Float[np.ndarray, "h w"]
    smooth: float
    reach_deg: float
    scale_sd_log: float


@dataclass(frozen=True, eq=False)
class Registration:
    """What a registration came to.

    Attributes:
        anatomy_T_camera: the pose of the camera, or None where it was refused.
        best: the most likely pose, whatever was decided: to look into, not to navigate by.
        status: `registered` or `refused`.
        reason: why it was refused, or None.
        probability: of being within 2 mm and 5° of the truth.
        scale: mm per unit of the observation.
        cost: −2 log likelihood, the mean over the rays.
        margin: how much more unlikely the best pose of another basin is, in −2 log likelihood.
        covariance: (6, 6) of the twist in the camera (mm, rad), if the basin is right; as large as errors of right
            poses came to on simulated trials.
        alternatives: (M,) the best poses of other basins, best first.
    """

    anatomy_T_camera: Pose | None
    best: Pose
    status: Literal["registered", "refused"]
    reason: str | None
    probability: float
    scale: float
    cost: float
    margin: float
    covariance: Float[np.ndarray, "6 6"]
    alternatives: Pose
