"""How the parameters of drawn noses go together: two hidden factors, size and swelling, as a Gaussian copula.

Every parameter stays uniform in its normal range, since the ranges are what is cited; the factors only say which ends
are met together. A parameter's loading is its correlation with a factor; two parameters that share factors have the
product of their loadings as their (normal) correlation. What literature says:

- Size follows sex. Öksüzler et al. 2019: 66 ± 5 mm in women and 72 ± 5 mm in men, so sex explains 9 of 34 mm² of the
  variance of the length, a correlation of 0.51. Samoliński, Grzanka, Gotlib 2007, Laryngoscope 117:1429: the head of
  the inferior turbinate lies 17.1 mm behind the isthmus in women, 19.3 mm in men, whose nasal cavities are larger.
- Where nothing is said for a measure we assume that sex shifts it about as much as the length: loadings of 0.5, or 0.4
  for parts of which we know less. Only lengths of turbinates follow the cavity more closely, an assumption of ours too.
- Swelling: mucosa is thick or thin all over, and what it fills is missing in the meatuses. Directions are physiology;
  all loadings are assumptions of ours, approximate.

Not said here, as the parameters cannot say it: a larger inferior turbinate or a concha bullosa on the concave side of a
bowed septum (both sides share their parameters), and a spur that is the higher the more the septum is bowed (the bow
has a sign). Valve angle, nostril width and irregularity are independent of all others: we have no source.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from naris.anatomy.builtin.parameters import NORMAL_RANGES

SIZE: Mapping[str, float] = {
    "cavity_length_mm": 0.8,
    "cavity_height_mm": 0.5,
    "inferior_meatus_half_width_mm": 0.5,
    "middle_meatus_half_width_mm": 0.5,
    "nostril_length_mm": 0.4,
    "columella_width_mm": 0.4,
    "valve_distance_mm": 0.4,
    "inferior_head_distance_mm": 0.5,
    "inferior_length_mm": 0.7,
    "inferior_height_mm": 0.4,
    "middle_head_setback_mm": 0.4,
    "middle_length_mm": 0.7,
    "superior_length_mm": 0.5,
    "choana_width_mm": 0.5,
    "choana_height_mm": 0.5,
    "nasopharynx_depth_mm": 0.4,
    "nasopharynx_width_mm": 0.5,
}
"""Loadings on the size of the person; the length knows more of it than its sex."""
SWELLING: Mapping[str, float] = {
    "inferior_thickness_mm": 0.6,
    "middle_thickness_mm": 0.5,
    "superior_thickness_mm": 0.4,
    "septum_thickness_mm": 0.5,
    "septal_swell_body_mm": 0.5,
    "common_meatus_width_mm": -0.5,
    "middle_olfactory_gap_mm": -0.4,
    "olfactory_cleft_width_mm": -0.3,
    "inferior_floor_gap_mm": -0.3,
}
"""Loadings on how swollen the mucosa is, within what is normal when decongested."""
_FACTORS = (SIZE, SWELLING)
_LOADINGS = np.array([[factor.get(name, 0.0) for factor in _FACTORS] for name in NORMAL_RANGES])
_OWN = np.sqrt(1 - (_LOADINGS**2).sum(axis=1))


def correlations() -> Float[np.ndarray, "n n"]:
    """The correlation matrix of the normal variables behind the parameters, in the order of `NORMAL_RANGES`.

    Positive definite by its making: each variable has a part of its own.
    """
    return _LOADINGS @ _LOADINGS.T + np.diag(_OWN**2)


def drawn_shares(rng: np.random.Generator) -> dict[str, float]:
    """Where in its normal range each parameter lies, from 0 to 1: each uniform, together as `correlations` says."""
    factors = rng.standard_normal(len(_FACTORS))
    shares = ndtr(_LOADINGS @ factors + _OWN * rng.standard_normal(len(_OWN)))
    return dict(zip(NORMAL_RANGES, shares.tolist(), strict=True))
