"""Other noses of the same kind: the parameters of the built-in nose, drawn from their normal ranges."""

from __future__ import annotations

import numpy as np

from naris.anatomy.builtin.layout import layout_of
from naris.anatomy.builtin.parameters import NORMAL_RANGES, NoseParameters
from naris.errors import InputError

_TRIES = 100


def drawn_parameters(rng: np.random.Generator) -> NoseParameters:
    """One adult nose at random: every parameter uniform in its normal range, independent of the others.

    Draws whose parts do not fit together are thrown away.

    Raises:
        InputError: if none of a hundred draws fits.
    """
    for _ in range(_TRIES):
        values = {name: float(rng.uniform(normal.low, normal.high)) for name, normal in NORMAL_RANGES.items()}
        whole = {name: round(value) for name, value in values.items() if isinstance(_default(name), int)}
        try:
            parameters = NoseParameters(**{**values, **whole}, irregularity_seed=int(rng.integers(2**31)))
            layout_of(parameters)
        except InputError:
            continue
        return parameters
    raise InputError("normal ranges whose noses fit together", f"none in {_TRIES} draws", "report this as a bug")


def _default(name: str) -> float | int:
    default: float | int = getattr(NoseParameters(), name)
    return default
