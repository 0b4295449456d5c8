"""A sinus is named by where it lies, in a large nose as in a small one, and on the side where it lies."""

from __future__ import annotations

import numpy as np
import pytest

from naris.airway.basins import Basins
from naris.airway.block import Block
from naris.airway.sinuses import SINUSES, Extent, named

ATTACHED = 4
PLACES_MM = {
    "left maxillary sinus": (27, 0.6, 14),
    "left ethmoid cells": (10, 0.6, 43),
    "left frontal sinus": (8, 0.35, 62),
    "sphenoid sinus": (2, 1.05, 38),
    None: (2, 0.5, -15),  # the mouth
}
"""To the left of the middle in mm, from the nostrils to the choanae as a share, above the floor in mm: an adult."""
DEPTH_MM = 68.0


def separate(part: np.ndarray) -> Basins:
    """Parts that do not touch."""
    size = np.bincount(part.ravel())
    return Basins(part, np.ones(len(size)), np.zeros((0, 2), np.int64), np.zeros(0), np.zeros(0), size)


def found(places_mm: np.ndarray, depth_mm: float, mirrored: bool = False) -> list[str | None]:
    """What parts are called that are cubes of 3 mm at these places, in a nose of that depth."""
    origin, step = np.array([-60.0, -20.0, -40.0]), 1.0
    part = np.zeros((120, 130, 130), np.int32)
    block = Block(np.zeros(part.shape, np.float32), origin, step)
    for number, (x, y, z) in enumerate(places_mm, start=1):
        i, j, k = np.rint((np.array([-x if mirrored else x, y, z]) - origin) / step).astype(int)
        part[i - 1 : i + 2, j - 1 : j + 2, k - 1 : k + 2] = number
    count = len(places_mm)
    basins = separate(part)
    marks = {}
    for side, x in (("left", 8.0), ("right", -8.0)):
        marks[f"{side}.nostril"], marks[f"{side}.choana"] = np.array([x, 0, 0]), np.array([x, depth_mm, 15])
        marks[f"{side}.nasal floor"] = np.array([x, depth_mm / 2, 0.0])
    labels = named(np.where(part > 0, ATTACHED, 0).astype(np.uint8), ATTACHED, basins, block, marks)
    of_part = [int(np.unique(labels[part == number]).item()) for number in range(1, count + 1)]
    assert (labels > 0).sum() == (part > 0).sum()
    return [None if one == ATTACHED else SINUSES[one - ATTACHED - 1] for one in of_part]


@pytest.mark.parametrize("size", [0.8, 1.0, 1.15])
def test_by_place_in_noses_of_any_size(size: float) -> None:
    places = np.array([[x * size, y * DEPTH_MM * size, z * size] for x, y, z in PLACES_MM.values()])
    assert found(places, DEPTH_MM * size) == list(PLACES_MM)


def test_a_mirrored_nose_has_its_sides_changed() -> None:
    places = np.array([[x, y * DEPTH_MM, z] for x, y, z in PLACES_MM.values()])
    changed = [name and name.replace("left", "right") for name in PLACES_MM]
    assert found(places, DEPTH_MM, mirrored=True) == changed


def test_the_cleft_lies_beside_the_septum_and_cells_beyond_it() -> None:
    extent = Extent(middle_mm=1.0, front_mm=-40.0, floor_mm=-20.0, depth_mm=70.0)
    cleft, cell, meatus, sphenoid = np.array(
        [[3.0, 0.0, 18.0], [14.0, 0.0, 18.0], [10.0, 0.0, -10.0], [2.0, 32.0, 18.0]]
    )
    places = np.stack([cleft, cell, meatus, sphenoid])
    assert extent.in_cleft(places).tolist() == [True, False, False, False]
    assert extent.beyond(places).tolist() == [False, True, False, False]


def test_without_attached_air_nothing_changes() -> None:
    labels = np.zeros((4, 4, 4), np.uint8)
    labels[1] = 2
    basins = separate(labels.astype(np.int32))
    block = Block(np.zeros(labels.shape, np.float32), np.zeros(3), 1.0)
    assert named(labels, ATTACHED, basins, block, {}) is labels
