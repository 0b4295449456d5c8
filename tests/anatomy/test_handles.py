"""Small handles go, large ones stay, and what has none is not touched."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from naris.anatomy.checks import check_surface
from naris.anatomy.handles import without_small_handles
from naris.anatomy.level_set import Field, surface

SPACING_MM = 0.6
AXIS = np.arange(-16, 16.1, SPACING_MM, dtype=np.float32)
X, Y, Z = np.meshgrid(AXIS, AXIS, AXIS, indexing="ij")
BALL = 14 - np.sqrt(X**2 + Y**2 + Z**2)


def genus(lumen: Field) -> int | None:
    return check_surface(*surface(lumen, np.zeros(3), SPACING_MM)).genus


def two_rooms(window_mm: float) -> Field:
    """A ball with a wall of 3 mm, a door far to one side and a round window in the middle."""
    inside = np.minimum(BALL, np.abs(X) - 1.5)
    door = np.minimum(BALL, Z - 11)
    return np.maximum.reduce([inside, door, np.minimum(BALL, window_mm / 2 - np.hypot(Y, Z))]).astype(np.float32)


def pillared(across_mm: float) -> Field:
    """A flat room of 4 mm with a pillar from floor to ceiling."""
    room = np.minimum(BALL, 2 - np.abs(Z))
    return np.minimum(room, np.hypot(X, Y - 2) - across_mm / 2).astype(np.float32)


def test_what_has_no_handle_is_the_very_same() -> None:
    assert without_small_handles(BALL, SPACING_MM) is BALL


@pytest.mark.parametrize("made", [two_rooms, pillared])
def test_small_handles_go_and_large_ones_stay(made: Callable[[float], Field]) -> None:
    small, large = made(2.0), made(6.0)
    assert genus(small) == genus(large) == 1
    mended = without_small_handles(small, SPACING_MM)
    assert genus(mended) == 0
    changed = mended != small
    assert np.ptp(np.argwhere(changed), axis=0).max() * SPACING_MM < 6
    assert without_small_handles(large, SPACING_MM) is large
