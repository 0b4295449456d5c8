"""How wrong a depth network is: a factor on the whole picture, an error that varies slowly over it, and the rest."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

_ROBUST = 1.4826  # the median of absolute normal errors times this is their deviation
_FARTHEST = 14  # cells between those that are compared


class DepthErrors(NamedTuple):
    """Of B pictures, NaN where nothing is known.

    Attributes:
        log_error: (B, I, J) logarithm of the range that was told over the true one.
        spread: (B, I, J) the scale of the error that was claimed.
        cell_deg: between the rays of neighbouring cells, in the middle of the picture.
    """

    log_error: Float[np.ndarray, "b i j"]
    spread: Float[np.ndarray, "b i j"]
    cell_deg: float

    @property
    def scale(self) -> Float[np.ndarray, "b"]:
        """The logarithm of the factor on each picture: the median of its errors."""
        return np.asarray(np.nanmedian(self.log_error, axis=(1, 2)))

    @property
    def shape(self) -> Float[np.ndarray, "b"]:
        """The median of the absolute errors of each picture once that factor is known."""
        return np.asarray(np.nanmedian(np.abs(self.log_error - self.scale[:, None, None]), axis=(1, 2)))


class ErrorModel(NamedTuple):
    """See `naris.locate.depth.ErrorShares`."""

    scale: float
    smooth: float
    reach_deg: float
    own: float


def error_model(errors: DepthErrors) -> ErrorModel:
    """What errors are made of, as shares of the median claim of their picture.

    The smooth part is that of a Gaussian variogram, σ² (1 − exp(−angle² / 2ℓ²)), on robust differences of cells of a
    row or a column; the own part is what is left at no distance, and the differences of neighbours as they are claimed.
    """
    known = np.isfinite(errors.log_error)
    claim = np.nanmedian(np.where(known, errors.spread, np.nan), axis=(1, 2))
    share = (errors.log_error - errors.scale[:, None, None]) / claim[:, None, None]
    apart = list(range(1, _FARTHEST + 1))
    differences = np.array([np.concatenate([_off(share, d, axis) for axis in (1, 2)]) for d in apart], dtype=object)
    size = np.array([_ROBUST * np.nanmedian(np.abs(one.astype(float))) / np.sqrt(2) for one in differences])
    angle = np.array(apart) * errors.cell_deg

    def left(x: np.ndarray) -> np.ndarray:
        smooth, reach, own = np.exp(x)
        return np.asarray(np.sqrt(smooth**2 * (1 - np.exp(-0.5 * (angle / reach) ** 2)) + own**2) - size)

    smooth, reach, _ = np.exp(least_squares(left, np.log([size[-1], angle[-1] / 2, size[0] / 2])).x)
    ratio = share * claim[:, None, None] / errors.spread
    own = np.concatenate([_off(ratio, 1, axis) for axis in (1, 2)])
    return ErrorModel(
        float(_ROBUST * np.median(np.abs(errors.scale / claim))),
        float(smooth),
        float(reach),
        float(_ROBUST * np.nanmedian(np.abs(own)) / np.sqrt(2)),
    )


def _off(values: Float[np.ndarray, "b i j"], apart: int, axis: int) -> Float[np.ndarray, "n"]:
    """Differences of cells so far apart along an axis, where both are known."""
    size = values.shape[axis]
    ends = [np.take(values, range(*part), axis=axis) for part in ((apart, size), (0, size - apart))]
    off = (ends[0] - ends[1]).ravel()
    return np.asarray(off[np.isfinite(off)])
