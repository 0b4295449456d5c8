# ruff: noqa: ANN001, ANN201, ANN202
# mypy: ignore-errors
"""What is seen from places against an observation, turned every way, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from naris.render.lanes import LANES, any_lane, choose, load, load_bytes, real, same, store, whole

_njit = njit(cache=True, nogil=True, fastmath=True, error_model="numpy", boundscheck=False)
_part_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False)
_inline_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False, forceinline=True)
_POSITIVE = 1024  # more than any difference of bytes


class Search(NamedTuple):
    """What is compared.

    Attributes:
        panoramas: (P, T) uint8 logarithms of ranges.
        seen: (M,) int32 those of the observation.
        texels: (R, M) where each ray looks after each turn.
        free: 1 to take off the mean difference, within `shifts`.
        cap: of each difference.
        shifts: the least and the most of them.
        sources: as those of `naris.register.steps.Sight`.
    """

    panoramas: np.ndarray
    seen: np.ndarray
    texels: np.ndarray
    free: int
    cap: int
    shifts: tuple[int, int]
    sources: np.ndarray


class Fits(NamedTuple):
    """The best few of each place (P, few): sums of differences, rising, and the turn and shift they belong to."""

    best: np.ndarray
    turn: np.ndarray
    shift: np.ndarray


@_njit
def compare(search, first, last, fits):
    """How well ranges fit what is seen from places first … last − 1, turned every way; the best few of each place.

    Sixteen places at once: after a turn a ray looks at the same texel from all of them.
    """
    texels, rays = search.texels, search.texels.shape[1]
    around = np.empty(search.panoramas.shape[1] * LANES, np.uint8)
    difference, best = np.empty(rays * LANES, np.int32), np.empty(LANES, np.int32)
    total, shift = np.empty(LANES, np.int32), np.empty(LANES, np.int32)
    few = fits.best.shape[1]
    for start in range(first, last, LANES):
        count = min(LANES, last - start)
        _side_by_side(search.panoramas, start, count, around)
        for k in range(LANES):
            best[k] = fits.best[start + min(k, count - 1), few - 1]
        for turn in range(texels.shape[0]):
            if search.free:
                sums, off = _differences_shifted(search, turn, around, difference)
            else:
                sums, off = _differences(search, turn, around), same(0)
            if any_lane(sums < load(best, 0)):
                store(total, 0, sums)
                store(shift, 0, off)
                for k in range(count):
                    if total[k] < best[k]:
                        _insert(fits, start + k, (total[k], turn, shift[k]))
                        best[k] = fits.best[start + k, few - 1]


@_part_njit
def _side_by_side(panoramas, start, count, around):
    """What is seen from sixteen places, texel by texel; the last one again where there are fewer."""
    for k in range(LANES):
        row = panoramas[start + min(k, count - 1)]
        for texel in range(len(row)):
            around[texel * LANES + k] = row[texel]


@_inline_njit
def _capped(difference, cap):
    size = choose(difference < 0, 0 - difference, difference)
    return choose(size < cap, size, cap)


@_inline_njit
def _differences(search, turn, around):
    """The sums of absolute differences after a turn."""
    cap = np.int32(search.cap)
    total = same(0)
    for ray in range(search.texels.shape[1]):
        total += _capped(search.seen[ray] - load_bytes(around, search.texels[turn, ray] * LANES), cap)
    return total


@_inline_njit
def _differences_shifted(search, turn, around, difference):
    """The same with the mean difference off, then that of those near it, both within `shifts`; and what was taken."""
    rays, cap = search.texels.shape[1], np.int32(search.cap)
    low, high = np.int32(search.shifts[0]), np.int32(search.shifts[1])
    total = same(0)
    for ray in range(rays):
        one = search.seen[ray] - load_bytes(around, search.texels[turn, ray] * LANES)
        store(difference, ray * LANES, one)
        total += one
    off = _within(_rounded_down(total, same(rays)), low, high)
    total, near = same(0), same(0)
    for ray in range(rays):
        one = load(difference, ray * LANES) - off
        is_near = choose(one < 0, 0 - one, one) < cap
        total += choose(is_near, one, 0)
        near += choose(is_near, 1, 0)
    off = choose(near > 0, _within(off + _rounded_down(total, choose(near > 0, near, 1)), low, high), off)
    total = same(0)
    for ray in range(rays):
        total += _capped(load(difference, ray * LANES) - off, cap)
    return total, off


@_inline_njit
def _within(x, low, high):
    x = choose(x < low, low, x)
    return choose(x > high, high, x)


@_inline_njit
def _rounded_down(total, count):
    """Their ratio, rounded down; the half keeps it off whole numbers, whatever the rounding of floats."""
    return whole((real(total) + np.float32(0.5)) / real(count) + np.float32(_POSITIVE)) - _POSITIVE


@_part_njit
def _insert(fits, place, fit):
    """Into the best few of a place, after those that are as good."""
    best, turn, shift = fits
    k = best.shape[1] - 1
    while k > 0 and best[place, k - 1] > fit[0]:
        best[place, k], turn[place, k], shift[place, k] = best[place, k - 1], turn[place, k - 1], shift[place, k - 1]
        k -= 1
    best[place, k], turn[place, k], shift[place, k] = fit
