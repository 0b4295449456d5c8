"""Other noses of the same kind: the parameters of the built-in nose, drawn from their normal ranges."""

from __future__ import annotations

from collections import Counter

import numpy as np

from naris.anatomy.builtin.correlations import drawn_shares
from naris.anatomy.builtin.layout import layout_of
from naris.anatomy.builtin.nose import built_in_nose
from naris.anatomy.builtin.parameters import NORMAL_RANGES, NoseParameters
from naris.anatomy.builtin.variants import Alteration, varied
from naris.anatomy.drawn import CLOSED, UNFIT, Drawn
from naris.core.anatomy import Anatomy
from naris.errors import InputError

_TRIES = 100


def drawn_parameters(rng: np.random.Generator) -> NoseParameters:
    """One adult nose at random: every parameter uniform in its normal range, correlated as `correlations` says.

    Draws whose parts do not fit together are thrown away, which bends both a little. What is left can nearly always be
    made; a nose whose passages close is refused by `built_in_nose`.

    Raises:
        InputError: if none of a hundred draws fits.
    """
    return _drawn_parameters(rng)[0]


def _drawn_parameters(rng: np.random.Generator) -> tuple[NoseParameters, int]:
    """`drawn_parameters`, and how many draws before it did not fit."""
    for unfit in range(_TRIES):
        values = {
            name: NORMAL_RANGES[name].low + share * (NORMAL_RANGES[name].high - NORMAL_RANGES[name].low)
            for name, share in drawn_shares(rng).items()
        }
        try:
            parameters = NoseParameters(**values, irregularity_seed=int(rng.integers(2**31)))
            layout_of(parameters)
        except InputError:
            continue
        return parameters, unfit
    raise InputError("normal ranges whose noses fit together", f"none in {_TRIES} draws", "report this as a bug")


def virtual_patient(seed: int, number: int, variant: str | None = None) -> Anatomy:
    """The nose of `draw_patient`, without what was passed over."""
    return draw_patient(seed, number, variant).anatomy


def draw_patient(seed: int, number: int, variant: str | None = None) -> Drawn:
    """The nose number `number` of a population; it depends on the seed, its number and the variant alone.

    Draws whose parts do not fit together or whose passages close are passed over.

    Args:
        seed, number: of it.
        variant: one of `naris.anatomy.builtin.variants.VARIANTS`; None for a nose within the normal ranges.

    Raises:
        InputError: if there is no such variant, or none of a hundred draws is open.
    """
    rng = np.random.default_rng([seed, number])
    called = f"virtual patient {number} of seed {seed}" + (f", {variant}" if variant else "")
    passed_over = Counter({UNFIT: 0, CLOSED: 0})
    for _ in range(_TRIES):
        parameters, unfit = _drawn_parameters(rng)
        passed_over[UNFIT] += unfit
        alterations: tuple[Alteration, ...] = ()
        try:
            if variant is not None:
                parameters, alterations = varied(variant, parameters, rng)
            nose = built_in_nose(parameters, alterations=alterations).with_(name=called)
        except InputError:
            passed_over[CLOSED] += 1
            continue
        return Drawn(nose, dict(+passed_over))
    raise InputError("normal ranges whose noses are open", f"none in {_TRIES} draws", "report this as a bug")
