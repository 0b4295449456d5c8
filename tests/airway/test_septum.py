"""The septum of made noses: where it stands, also where it is not seen, and what is given back to its side."""

from __future__ import annotations

import numpy as np
import pytest

from naris.airway.basins import basins_of, wall_mm
from naris.airway.septum import given_back, mirrored_parts, seam_of, septum_of

STEP_MM = 0.5
RIGHT, LEFT, PHARYNX, ATTACHED = 1, 2, 3, 4
SHAPE = (60, 60, 60)


def middle(bend_mm: float) -> np.ndarray:
    """x of a septum that bends to the left in its middle, in nodes, over (y, z)."""
    y, z = np.meshgrid(*(np.linspace(-1, 1, n) for n in SHAPE[1:]), indexing="ij")
    return 29.5 + bend_mm / STEP_MM * np.cos(np.pi / 2 * y) * np.cos(np.pi / 2 * z)


def two_sides(bend_mm: float = 0.0, half_mm: float = 1.0) -> np.ndarray:
    """Air of both sides, 5 mm wide, beside a septum."""
    beyond = np.arange(SHAPE[0])[:, None, None] - middle(bend_mm)
    labels = np.zeros(SHAPE, np.uint8)
    near, far = half_mm / STEP_MM, (half_mm + 5) / STEP_MM
    labels[(beyond < -near) & (beyond > -far)] = RIGHT
    labels[(beyond > near) & (beyond < far)] = LEFT
    labels[:, :, [0, -1]] = 0
    return labels


@pytest.mark.parametrize("bend_mm", [0.0, 3.0, -5.0])
def test_it_stands_in_the_middle_of_the_tissue(bend_mm: float) -> None:
    septum = septum_of(two_sides(bend_mm), STEP_MM)
    assert septum is not None
    off_mm = np.abs(septum.index - middle(bend_mm)) * STEP_MM
    assert off_mm[4:-4, 4:-4].max() < 0.7


def test_without_a_second_side_there_is_none() -> None:
    labels = two_sides()
    labels[labels == LEFT] = 0
    assert septum_of(labels, STEP_MM) is None


def test_a_turbinate_is_not_taken_for_it() -> None:
    """Where the right cleft counts as left, a turbinate beside it stands between right and left."""
    labels = two_sides()
    labels[24:30, 20:34, 44:56] = LEFT
    labels[22:24, 20:34, 44:56] = 0
    septum = septum_of(labels, STEP_MM)
    assert septum is not None
    assert np.abs(septum.index[20:34, 44:56] - 29.5).max() * STEP_MM < 1.0


def test_a_cleft_on_the_wrong_side_is_given_back() -> None:
    true = two_sides()
    true[28:32, 20:40, 44:56] = LEFT  # so thin that both clefts are one piece of air
    wrong = true.copy()
    wrong[(true == RIGHT) & (np.arange(60) > 43) & (np.abs(np.arange(60) - 30) < 10)[:, None]] = LEFT
    assert (wrong == LEFT).sum() > (true == LEFT).sum() + 500
    septum = septum_of(wrong, STEP_MM)
    assert septum is not None
    given = given_back(wrong, septum)
    assert (given[:28] != LEFT).all()
    assert (given[32:] == true[32:]).all()


def test_what_does_not_hang_together_with_its_side_is_not_given() -> None:
    labels = two_sides()
    labels[15:29, 20:40, 40:58] = 0
    labels[24:27, 26:34, 46:52] = LEFT
    septum = septum_of(labels, STEP_MM)
    assert septum is not None
    assert np.array_equal(given_back(labels, septum), labels)


def test_right_labels_stay() -> None:
    labels = two_sides(4.0)
    septum = septum_of(labels, STEP_MM)
    assert septum is not None
    assert np.array_equal(given_back(labels, septum), labels)


@pytest.mark.parametrize(("hu", "wall"), [(-450.0, True), (-1000.0, False)], ids=["grey", "clear"])
def test_grey_air_between_the_sides_gets_a_wall_and_clear_air_is_a_hole(hu: float, wall: bool) -> None:
    labels = two_sides()
    labels[28:30, 20:30, 20:30], labels[30:32, 20:30, 20:30] = RIGHT, LEFT
    values = np.full(SHAPE, -1000.0, np.float32)
    values[28:32, 20:30, 20:30] = hu
    seam = seam_of(labels, values, PHARYNX, STEP_MM)
    area_mm2 = seam.wall_mm2 if wall else seam.hole_mm2
    assert area_mm2 == pytest.approx(25.0, rel=0.3)
    assert min(seam.wall_mm2, seam.hole_mm2) == 0
    assert seam.wall.any() == wall


def test_where_the_sides_meet_at_the_pharynx_is_no_wall() -> None:
    labels = two_sides()
    labels[28:30, 48:, 20:30], labels[30:32, 48:, 20:30] = RIGHT, LEFT
    labels[:, 50:][labels[:, 50:] > 0] = PHARYNX
    assert not seam_of(labels, np.full(SHAPE, -500.0, np.float32), PHARYNX, STEP_MM).wall.any()


def meatus(joined_to_sinus: bool = False) -> tuple[np.ndarray, np.ndarray]:
    """Labels in which the right meatus is shut off by a turbinate, its left image is not, and the true labels."""
    true = two_sides()
    true[8:12, 10:50, 6:30], true[12:17, 10:50, 6:8] = RIGHT, RIGHT
    true[48:52, 10:50, 6:30], true[42:48, 10:50, 6:8] = LEFT, LEFT
    labels = true.copy()
    labels[8:12, 10:50, 6:30] = ATTACHED
    if joined_to_sinus:
        labels[1:7, 10:50, 10:50] = ATTACHED
        labels[7:8, 24:28, 20:24] = ATTACHED
        true[1:8][labels[1:8] == ATTACHED] = ATTACHED
    return labels, true


@pytest.mark.parametrize("joined", [False, True], ids=["alone", "holed wall"])
def test_a_meatus_that_is_shut_off_on_one_side_is_nose_there_too(joined: bool) -> None:
    labels, true = meatus(joined)
    septum = septum_of(labels, STEP_MM)
    assert septum is not None
    air = labels > 0
    found = mirrored_parts(labels, labels == ATTACHED, basins_of(air, wall_mm(air, STEP_MM), STEP_MM), septum)
    assert ((found == RIGHT) == (true == RIGHT))[8:].mean() > 0.998
    assert (found[1:6] == labels[1:6]).all()


def test_a_sinus_without_an_image_in_the_nose_stays() -> None:
    labels = two_sides()
    labels[2:14, 10:50, 10:50] = ATTACHED
    septum = septum_of(labels, STEP_MM)
    assert septum is not None
    air = labels > 0
    basins = basins_of(air, wall_mm(air, STEP_MM), STEP_MM)
    assert np.array_equal(mirrored_parts(labels, labels == ATTACHED, basins, septum), labels)
