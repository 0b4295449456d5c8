"""Places compared sixteen at a time against the same sums by numpy, place by place and turn by turn."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from naris.register.compare import Fits, Search, compare

FEW, CAP, NONE = 3, 24, 2**30


def search_of(places: int, turns: int, rays: int, *, free: bool, shifts: tuple[int, int] = (-60, 60)) -> Search:
    rng = np.random.default_rng(5)
    panoramas = rng.integers(60, 180, (places, 256)).astype(np.uint8)
    texels = rng.integers(0, 256, (turns, rays)).astype(np.int32)
    # What the third place shows after the second turn, nearer by a factor where that is free, with some noise.
    seen = panoramas[2, texels[1]].astype(np.int32) + (25 if free else 0) + rng.integers(-3, 4, rays)
    return Search(panoramas, seen.astype(np.int32), texels, int(free), CAP, shifts, np.zeros(1, np.int32))


def compared(search: Search, edges: list[int]) -> Fits:
    shape = len(search.panoramas), FEW
    fits = Fits(np.full(shape, NONE, np.int32), np.zeros(shape, np.int32), np.zeros(shape, np.int32))
    for first, last in pairwise(edges):
        compare(search, first, last, fits)
    return fits


def by_numpy(search: Search) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sums (P, R) of each place and turn, and shifts; then the best few of each place, the earlier turn first."""
    difference = search.seen - search.panoramas[:, search.texels].astype(np.int64)
    off = np.zeros(difference.shape[:2], np.int64)
    if search.free:
        off = np.clip(difference.sum(-1) // difference.shape[-1], *search.shifts)
        near = np.abs(difference - off[..., None]) < CAP
        count, total = near.sum(-1), np.where(near, difference - off[..., None], 0).sum(-1)
        off = np.where(count > 0, np.clip(off + total // np.maximum(count, 1), *search.shifts), off)
    sums = np.minimum(np.abs(difference - off[..., None]), CAP).sum(-1)
    turn = np.argsort(sums, axis=1, kind="stable")[:, :FEW]
    return np.take_along_axis(sums, turn, 1), turn, np.take_along_axis(off, turn, 1)


@pytest.mark.parametrize("free", [False, True])
@pytest.mark.parametrize("places", [1, 16, 37])
def test_sums_turns_and_shifts_are_those_of_numpy(free: bool, places: int) -> None:
    search = search_of(max(places, 3), 40, 49, free=free)
    fits = compared(search, [0, len(search.panoramas)])
    for one, expected in zip(fits, by_numpy(search), strict=True):
        np.testing.assert_array_equal(one, expected)
    assert fits.turn[2, 0] == 1 and (not free or abs(fits.shift[2, 0] - 25) <= 1)


def test_parts_may_begin_anywhere() -> None:
    search = search_of(45, 20, 30, free=True)
    whole, parts = compared(search, [0, 45]), compared(search, [0, 7, 30, 31, 45])
    for one, other in zip(whole, parts, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_shift_stays_within_its_limits() -> None:
    search = search_of(20, 30, 49, free=True, shifts=(-4, 9))
    fits = compared(search, [0, 20])
    assert fits.shift.min() >= -4 and fits.shift.max() <= 9
    np.testing.assert_array_equal(fits.best, by_numpy(search)[0])
