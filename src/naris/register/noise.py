"""How wrong what was seen is, and in what unit: stated by the caller and never guessed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from naris.errors import InputError

_LEAST_SD_LOG, _MOST_SD_LOG = 1e-6, 3.0


@dataclass(frozen=True)
class Scale:
    """What is known of the size of an observation.

    Attributes:
        kind: `known` (the observation is in mm), `unknown` (any factor from `low` to `high` makes mm of it), or
            `prior` (the factor is log-normal about `factor`).
        factor: mm per unit of the observation, where there is a guess.
        sd_log: standard deviation of the logarithm of the factor, of a prior.
        low, high: the factors that an unknown scale is sought between.
    """

    kind: str = "known"
    factor: float = 1.0
    sd_log: float = 0.0
    low: float = 0.4
    high: float = 2.5

    def __post_init__(self) -> None:
        if self.kind not in ("known", "unknown", "prior"):
            raise InputError("a scale that is known, unknown or prior", repr(self.kind), "name one of the three")
        is_prior = self.kind == "prior"
        fits = (
            0 < self.low < self.high < np.inf
            and 0 < self.factor < np.inf
            and (_LEAST_SD_LOG <= self.sd_log <= _MOST_SD_LOG if is_prior else self.sd_log == 0)
            and (self.factor == 1 or is_prior)
        )
        if not fits:
            raise InputError(
                "positive factors, low below high, a factor and a deviation (1e-6 to 3) for a prior only",
                f"{self}",
                "correct the scale, or multiply what was seen by the factor",
            )

    @property
    def free(self) -> bool:
        return self.kind != "known"

    @property
    def middle(self) -> float:
        """The factor to begin with."""
        return math.sqrt(self.low * self.high) if self.kind == "unknown" else self.factor


KNOWN, UNKNOWN = Scale(), Scale("unknown")
ENDOSCOPIC_MM = 3.0, 30.0
"""How far away the walls are that an endoscope looks at, in the median."""


def any_scale(median: float) -> Scale:
    """Of what lies so far away in a unit of its own: any factor that makes `ENDOSCOPIC_MM` of it.

    Raises:
        InputError: if the median is not above 0.
    """
    if not 0 < median < np.inf:
        raise InputError("a median distance above 0", f"{median:g}", "check the depth or the points")
    low, high = ENDOSCOPIC_MM
    return Scale("unknown", low=low / median, high=high / median)


@dataclass(frozen=True)
class DepthNoise:
    """How wrong a depth image is.

    Attributes:
        smooth: standard deviation of a relative error that varies smoothly over the picture.
        reach_deg: how far it stays alike: the angle at which its correlation has fallen to exp(−1/2).
        pixel_mm: standard deviation along the ray of an error of each pixel by itself, in the unit of the depth.
        outliers: the share of pixels that tell nothing.
    """

    smooth: float = 0.05
    reach_deg: float = 9.3
    pixel_mm: float = 0.3
    outliers: float = 0.02

    def __post_init__(self) -> None:
        sizes = 0 <= self.smooth < np.inf and 0 <= self.pixel_mm < np.inf and 0 < self.reach_deg < np.inf
        if not sizes or not 0 < self.outliers < 1:
            raise InputError(
                "errors from 0 up, a reach above 0 and a share of outliers between 0 and 1", f"{self}", "correct them"
            )


@dataclass(frozen=True)
class PointNoise:
    """How wrong the points of a cloud are: the same in every direction, but for outliers.

    Attributes:
        sd_mm: standard deviation of a point, in the unit of the points.
        outliers: the share of points that tell nothing.
        normals_deg: standard deviation of its normal, where there are normals.
    """

    sd_mm: float = 0.5
    outliers: float = 0.1
    normals_deg: float = 15.0

    def __post_init__(self) -> None:
        if not (0 < self.sd_mm < np.inf and 0 < self.outliers < 1 and 0 < self.normals_deg < np.inf):
            raise InputError(
                "deviations above 0 and a share of outliers between 0 and 1", f"{self}", "correct the noise"
            )
