# ruff: noqa: ANN001, ANN201, ANN202
# mypy: ignore-errors
"""What is seen from places against an observation, turned every way, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

_njit = njit(cache=True, nogil=True, fastmath=True, error_model="numpy", boundscheck=False)
_part_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False)


class Search(NamedTuple):
    """What is compared.

    Attributes:
        panoramas: (P, T) uint8 logarithms of ranges.
        seen: (M,) those of the observation.
        texels: (R, M) where each ray looks after each turn.
        free: 1 to take off the mean difference, within `shifts`.
        cap: of each difference.
    """

    panoramas: np.ndarray
    seen: np.ndarray
    texels: np.ndarray
    free: int
    cap: int
    shifts: tuple[int, int]


class Fits(NamedTuple):
    """The best few of each place (P, few): sums of differences, rising, and the turn and shift they belong to."""

    best: np.ndarray
    turn: np.ndarray
    shift: np.ndarray


@_njit
def compare(search, first, last, fits):
    """How well ranges fit what is seen from places first … last − 1, turned every way; the best few of each place."""
    seen, texels, free, cap = search.seen, search.texels, search.free, search.cap
    best, turn, shift = fits.best, fits.turn, fits.shift
    turns, rays = texels.shape
    few, half = best.shape[1], rays // 2
    difference = np.empty(rays, np.int32)
    for p in range(first, last):
        row = search.panoramas[p]
        for r in range(turns):
            total = 0
            for m in range(half):
                difference[m] = seen[m] - np.int32(row[texels[r, m]])
                total += min(abs(difference[m]), cap)
            if total >= best[p, few - 1] and not free:
                continue
            for m in range(half, rays):
                difference[m] = seen[m] - np.int32(row[texels[r, m]])
            off = _shift(difference, cap, search.shifts) if free else 0
            total = 0
            for m in range(rays):
                total += min(abs(difference[m] - off), cap)
            if total < best[p, few - 1]:
                k = few - 1
                while k > 0 and best[p, k - 1] > total:
                    best[p, k], turn[p, k], shift[p, k] = best[p, k - 1], turn[p, k - 1], shift[p, k - 1]
                    k -= 1
                best[p, k], turn[p, k], shift[p, k] = total, r, off


@_part_njit
def _shift(difference, cap, shifts):
    """The mean difference, then that of those near it, both within `shifts`."""
    rays, total = len(difference), 0
    for m in range(rays):
        total += difference[m]
    off = min(max(total // rays, shifts[0]), shifts[1])
    total, near = 0, 0
    for m in range(rays):
        d = difference[m] - off
        if abs(d) < cap:
            total += d
            near += 1
    return min(max(off + total // near, shifts[0]), shifts[1]) if near else off
