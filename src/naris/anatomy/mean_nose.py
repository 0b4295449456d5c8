"""What is known about the mean nose of Sinha et al. 2018: how to recognise it, and its named passages.

The published file is `PLY/ASR.ply` of github.com/AyushiSinha/AutoInitialization (MIT). Its frame is its own, `mean`:
millimetres, x to the left, y from the nostril (−42) back to the nasopharynx (+34), z up; one side of the nose.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from naris.anatomy.passages import Route
from naris.core.anatomy import Between, Entrance

FRAME = "mean"
NAME = "mean nose"
_VERTICES, _FACES = 14056, 28136
_BOUNDS_MM = np.array([[-10.937, -42.279, -20.926], [8.508, 34.267, 30.084]])
_BOUNDS_TOLERANCE_MM = 0.01

AIRSPACE = Between(entrance=Entrance(low_mm=(-1.5, -42.0, -12.0), high_mm=(8.0, -25.0, 18.0)))
"""The published surface encloses the tissue (septum, turbinates, floor and lateral wall). In the vestibule only the
septum is modelled; there the air ends level with the front of the septum and the lateral wall."""

_NOSTRIL = np.array([2.5, -37.0, 2.0])
_CHOANA = np.array([1.0, 30.0, -7.0])
ROUTES = (
    Route("main", _NOSTRIL, _CHOANA),
    Route("inferior meatus", _NOSTRIL, np.array([-8.5, 16.0, -15.0]), (np.array([-6.5, -3.0, -3.0]),)),
    Route("middle meatus", _NOSTRIL, _CHOANA, (np.array([-4.0, 6.0, 2.0]),)),
    Route("olfactory cleft", _NOSTRIL, np.array([4.0, -10.5, 18.0])),
    Route("floor", _NOSTRIL, _CHOANA, (np.array([3.0, -15.0, -13.0]), np.array([2.0, 4.0, -18.0]))),
)
"""From the nostril: between septum and turbinates to the choana, under the inferior turbinate, under the middle
turbinate, up to the roof between septum and middle turbinate, and over the floor."""


def is_mean_nose(vertices_mm: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> bool:
    """Whether this is the published surface, in whatever file format: the same counts and bounds."""
    if (len(vertices_mm), len(faces)) != (_VERTICES, _FACES):
        return False
    bounds = np.stack([vertices_mm.min(axis=0), vertices_mm.max(axis=0)])
    return bool(np.abs(bounds - _BOUNDS_MM).max() < _BOUNDS_TOLERANCE_MM)
