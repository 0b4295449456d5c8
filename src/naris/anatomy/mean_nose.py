"""What is known about the mean nose of Sinha et al. 2018: how to recognise it, and its named passages.

The published file is `PLY/ASR.ply` of github.com/AyushiSinha/AutoInitialization (MIT). Its frame is its own, `mean`:
millimetres, x to the left, y from the nostril (−42) back to the nasopharynx (+34), z up; one side of the nose.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from naris.anatomy.passages import Route

FRAME = "mean"
NAME = "mean nose"
_VERTICES, _FACES = 14056, 28136
_BOUNDS_MM = np.array([[-10.937, -42.279, -20.926], [8.508, 34.267, 30.084]])
_BOUNDS_TOLERANCE_MM = 0.01

_NOSTRIL = np.array([6.7, -40.5, 0.0])
ROUTES = (
    Route("main", _NOSTRIL, np.array([6.0, 32.0, -9.0])),
    Route("inferior", _NOSTRIL, np.array([-2.0, 26.0, -14.0]), (np.array([-1.5, 4.0, -12.0]),)),
    Route("middle", _NOSTRIL, np.array([-1.5, 27.0, -2.0]), (np.array([1.0, 4.0, 6.0]),)),
    Route("superior", _NOSTRIL, np.array([7.0, 14.5, 21.5])),
    Route("floor", _NOSTRIL, np.array([-8.0, 31.0, -13.0]), (np.array([2.0, 0.0, -19.0]),)),
)
"""From the front of the nose to its far ends: straight along the flat medial wall, through the lower and the middle
wide part, to the top, and over the floor to the lateral wall."""


def is_mean_nose(vertices_mm: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> bool:
    """Whether this is the published surface, in whatever file format: the same counts and bounds."""
    if (len(vertices_mm), len(faces)) != (_VERTICES, _FACES):
        return False
    bounds = np.stack([vertices_mm.min(axis=0), vertices_mm.max(axis=0)])
    return bool(np.abs(bounds - _BOUNDS_MM).max() < _BOUNDS_TOLERANCE_MM)
