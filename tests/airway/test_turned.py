"""A head that a wrong header turns round, or in another unit, is refused with what is likely wrong."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from naris.airway.turned import airway_in
from naris.core.volume import Volume
from naris.errors import ScanError
from tests import simulated_head


def changed(*scales: float) -> Volume:
    """The simulated head with its axes to the left, backwards and upwards stretched or turned."""
    volume = simulated_head.scan()
    return replace(volume, frame_T_index=np.diag([*scales, 1.0]) @ volume.frame_T_index)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("signs", "told"),
    [
        ((1, -1, 1), "looks back to front: turned round, a nose is found"),
        ((-1, -1, 1), "looks back to front: turned round, a nose is found"),
        ((1, 1, -1), "looks upside down: turned round, a nose is found"),
    ],
    ids=["y mirrored", "turned about z", "z mirrored"],
)
def test_a_head_that_is_turned_round_is_told_so(signs: tuple[float, float, float], told: str) -> None:
    with pytest.raises(ScanError, match=told):
        airway_in(changed(*signs), [0.8])


@pytest.mark.slow
def test_a_mirrored_head_has_a_nose_like_any_other() -> None:
    """Nothing in it tells left from right, as the documents say."""
    airway_in(changed(-1, 1, 1), [0.8])


@pytest.mark.parametrize(("factor", "unit"), [(0.1, "centimetres"), (10.0, "tenths of a millimetre")])
def test_a_scan_of_no_size_of_a_head_is_told_its_unit(factor: float, unit: str) -> None:
    with pytest.raises(ScanError, match=rf"are the spacings in {unit}\?"):
        airway_in(changed(factor, factor, factor), [0.8])
