"""The passages of the built-in nose: from a nostril through a meatus, as far as a camera goes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from naris.anatomy.builtin.landmarks import SIDES
from naris.anatomy.passages import Route

_THROUGH = {
    "septal": ("nostril", "valve", "common meatus", "choana approach", "nasopharynx"),
    "inferior": ("nostril", "valve", "inferior meatus entrance", "inferior meatus"),
    "middle": ("nostril", "valve", "middle meatus", "choana approach", "nasopharynx"),
    "superior": ("nostril", "valve", "olfactory approach", "superior meatus"),
}


def routes(landmarks_mm: dict[str, Float[np.ndarray, "3"]]) -> tuple[Route, ...]:
    """Four passages a side: along the septum, into the inferior, through the middle and to the superior meatus."""
    found = []
    for side in SIDES:
        for name, stops in _THROUGH.items():
            names = [stop if stop in landmarks_mm else f"{side}.{stop}" for stop in stops]
            points = [landmarks_mm[stop] for stop in names]
            found.append(Route(f"{side}.{name}", points[0], points[-1], tuple(points[1:-1])))
    return tuple(found)
