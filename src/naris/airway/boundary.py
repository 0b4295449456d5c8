"""Where air ends and tissue begins, between the voxels and place by place.

Across a wide passage the boundary lies where the blurred step is half-way between air and tissue. A slit is blurred
from both sides: its darkest value is no longer that of air, and its walls lie at a level between half-way and that
value. For a slit of width w under a Gaussian point spread σ, with u = w / (2√2 σ), the darkest value has the share
p = erf(u) of the full contrast and the walls the share e = erf(2u) / 2, so that e = erf(2 erfinv(p)) / 2 whatever σ is.

At that level a slit that is narrower than the lattice is open where a node happens to lie in its middle, and closed
beside it. Half-way between its darkest value and its walls, e = p / 2, it stays open, and is drawn too wide. The level
taken is the mean of the two: expert labels of a real scan agree with it better than with e alone (`docs/scans.md`).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32
from scipy.ndimage import gaussian_filter, maximum_filter, minimum_filter
from scipy.special import erf, erfinv

from naris.airway.block import Block

_NOISE_MM = 0.2  # deviation of the blur against noise before extremes are taken
_DARK_MM, _LIGHT_MM = 1.0, 1.5  # half the edge of the cube in which they are sought
_AIR_HU, _FAT_HU, _TISSUE_HU = -1000.0, -100.0, 60.0  # what is darker than air or lighter (bone, metal) counts as these
_CONTRAST_HU = 400.0  # less than this is no wall
_LOW_HU, _MIDDLE_HU, _HIGH_HU = -500.0, -450.0, -200.0  # limits, and where there is no wall near


def air_level(block: Block) -> Float32[np.ndarray, "nx ny nz"]:
    """How much darker than the boundary to tissue each node is, in HU: positive in air, 0 on the boundary."""
    blurred = gaussian_filter(block.hu, _NOISE_MM / block.step_mm)
    dark = np.maximum(minimum_filter(blurred, _edge(_DARK_MM, block)), _AIR_HU)
    light = np.clip(maximum_filter(blurred, _edge(_LIGHT_MM, block)), _FAT_HU, _TISSUE_HU)
    full = light - _AIR_HU
    share = np.clip((light - dark) / full, 0.0, 0.999)
    wall = (erf(2 * erfinv(share)) / 2 + share / 2) / 2
    threshold = np.where(light - dark > _CONTRAST_HU, np.clip(light - full * wall, _LOW_HU, _HIGH_HU), _MIDDLE_HU)
    return np.asarray(threshold - block.hu, dtype=np.float32)


def _edge(half_mm: float, block: Block) -> int:
    """Nodes along the edge of a cube."""
    return 2 * round(half_mm / block.step_mm) + 1
