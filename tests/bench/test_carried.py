"""How right carried regions are: on a transfer that is perfect, and on one that is off by a known length."""

from __future__ import annotations

import numpy as np
import pytest

from naris.anatomy.transfer import Fit, Transfer
from naris.bench.carried import right
from naris.core.anatomy import GridRegions
from tests.winding_tube import SLABS, winding_tube

ORIGIN_MM = np.array([-15.0, -55.0, -20.0])
SHAPE = (31, 111, 41)


def carried(off_mm: float) -> Transfer:
    """The slabs of the tube, moved backwards."""
    nodes = ORIGIN_MM + np.stack(np.meshgrid(*[np.arange(n) for n in SHAPE], indexing="ij"), axis=-1)
    labels = SLABS.label(nodes - [0, off_mm, 0]).astype(np.int8)
    regions = GridRegions("slabs", SLABS.names, "LPS", labels, ORIGIN_MM, 1.0)
    sure, lumen = np.full(SHAPE, 0.9, np.float32), np.ones(SHAPE, dtype=bool)
    return Transfer(regions, sure, lumen, 0.9, (Fit("itself", 0.0, 0.0, 1.0),))


def test_the_truth_is_right_everywhere_away_from_borders() -> None:
    found = right(carried(0.0), winding_tube())
    assert found.off_borders == 1.0
    assert found.everywhere > 0.97
    assert found.likely == 0.9


def test_borders_that_are_off_cost_what_lies_between() -> None:
    """Three borders, 4 mm of 80 each."""
    found = right(carried(4.0), winding_tube())
    assert found.everywhere == pytest.approx(1 - 3 * 4 / 80, abs=0.04)
    assert found.everywhere < found.off_borders < 0.93
