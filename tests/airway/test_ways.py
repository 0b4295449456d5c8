"""Where the two sides of a nose meet: behind the septum, whatever holes it has in front of that."""

from __future__ import annotations

import numpy as np
import pytest

from naris.airway.basins import wall_mm
from naris.airway.ways import choana_row

STEP_MM = 0.5
CHOANA = 60


def nose(hole: int = 0, height: int = 30) -> np.ndarray:
    """Two straight cavities of 6 mm beside a septum of 2 mm that ends at row `CHOANA`, with a hole of so many nodes."""
    air = np.zeros((32, 90, 40), bool)
    air[2:14, 4:86, 4 : 4 + height] = True
    air[18:30, 4:86, 4 : 4 + height] = True
    air[14:18, CHOANA:86, 4 : 4 + height] = True
    air[14:18, CHOANA - 1 - hole : CHOANA - 1, 15 : 15 + hole] = True  # a thin rest of septum stays behind it
    return air


def way(x: int, last: int = 85) -> np.ndarray:
    """From the pharynx to the nostril."""
    return np.array([[x, y, 16] for y in range(last, 3, -1)])


def row(air: np.ndarray, right: np.ndarray, left: np.ndarray) -> int:
    return choana_row(air, wall_mm(air, STEP_MM), right, left)


def test_the_choana_lies_where_the_septum_ends() -> None:
    assert row(nose(), way(8), way(24)) == pytest.approx(CHOANA, abs=4)


@pytest.mark.parametrize("hole", [2, 4, 6])
def test_a_hole_in_the_septum_right_before_the_choana_is_no_choana(hole: int) -> None:
    holed = nose(hole)
    holed[14:18, CHOANA - 1, 15 : 15 + hole] = True  # so that it is one with the space behind
    assert row(holed, way(8), way(24)) == pytest.approx(row(nose(), way(8), way(24)), abs=1)


def test_a_narrow_place_behind_the_choana_hides_nothing() -> None:
    """As enlarged adenoids make it: the ways themselves run through less room than a wide join has."""
    narrowed = nose()
    narrowed[:, 74:78, 4:14] = narrowed[:, 74:78, 19:34] = False
    assert row(narrowed, way(8), way(24)) == row(nose(), way(8), way(24))


def test_ways_that_end_at_different_places_meet_all_the_same() -> None:
    """The lowest air of the pharynx may be several nodes; the ways then share none."""
    assert row(nose(), way(8, last=85), way(24, last=80)) == row(nose(), way(8), way(24))


def test_a_nose_that_is_narrow_throughout_has_a_choana_too() -> None:
    narrow = nose()
    narrow[2:11] = narrow[21:30] = False
    narrow[14:18, CHOANA:86, 4:34] = True
    assert row(narrow, way(12), way(19)) == pytest.approx(CHOANA, abs=4)
