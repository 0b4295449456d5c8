"""Compiled code that is taken from disk must be that of today's sources, all of them."""

from __future__ import annotations

import hashlib
from importlib.util import find_spec
from pathlib import Path

import numpy as np

OF_PACKETS = ("naris.render.lanes", "naris.render.lane_functions", "naris.render.packets")
"""What rays in packets are made of."""


def sources_of(*modules: str) -> np.ndarray:
    """An array whose type changes with the sources of some modules: numba looks at one only when
    it takes old code."""
    hasher = hashlib.sha256()
    for name in modules:
        spec = find_spec(name)
        if spec is not None and spec.origin is not None:
            hasher.update(Path(spec.origin).read_bytes())
    return np.zeros(1, [(f"sources_{hasher.hexdigest()[:16]}", np.int32)])
