"""Whether slices follow each other as those of one patient do, judged by their pixels alone.

Two scans under one name need not differ in any tag. But in one patient the next slice resembles a slice more than the
one after next does, and no gap is much wider than the gaps around it. Measured on real and simulated scans, every slice
or every fourth, with noise up to 200 HU and with metal: the change over two slices is 1.2 to 2 times that over one,
but 0.2 to 0.5 times where two scans alternate; a change is at most 2.4 times those around it, but 5 to 20 times where a
slice or a block is of another head.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float, Int16

from naris.ct.scan import Finding
from naris.errors import ScanError

_SIDE = 64  # blocks along each side of a slice, whose means are compared: noise and detail do not count
_RANGE_HU = (-1000, 500)  # what metal and its streaks do beyond this does not count
_EMPTY_HU = 1.0
_AROUND = 4  # changes on either side that a change is compared with
_ALTERNATING, _ALTERNATING_SLICES = 0.75, 5
_FLAGGED, _REFUSED, _REFUSED_NEAR_METAL = 3.0, 5.0, 8.0
_METAL_HU, _METAL = 2500, 1e-4  # and the share of a slice with it from which its streaks may be to blame

Told = Callable[[int], str]
"""How people call slice number k."""


def slice_number(k: int) -> str:
    """`slice 12`, counted from 0."""
    return f"slice {k}"


def check_continuity(
    hu: Int16[np.ndarray, "ni nj nk"], axis: int = 2, told: Told = slice_number
) -> tuple[Finding, ...]:
    """See that the slices along an axis are of one scan; a warning where that is not sure.

    Raises:
        ScanError: if two scans alternate, or slices are far from any likeness to their neighbours.
    """
    slices = np.moveaxis(hu, axis, 0)
    means = np.stack([_block_means(one) for one in slices])
    filled = np.flatnonzero(np.ptp(means, axis=(1, 2)) > _EMPTY_HU)
    if not len(filled):
        return ()
    # Slices of nothing at the ends, which straightening a scan leaves, are unlike any other and no fault.
    first, last = int(filled[0]), int(filled[-1])
    means = means[first : last + 1]
    if len(means) < 2 * _AROUND:
        return ()
    _check_alternation(means, first, told)
    jumps = _jumps(np.abs(np.diff(means, axis=0)).mean(axis=(1, 2)))
    places = np.flatnonzero(jumps >= _FLAGGED)
    if not len(places):
        return ()
    pairs = [f"{told(first + k)} and {told(first + k + 1)}" for k in places.tolist()]
    text = f"{', '.join(pairs[:3])}{' and others' if len(pairs) > 3 else ''} differ up to {jumps.max():.0f} times as"
    if any(jumps[k] >= _sure(slices, first + k) for k in places.tolist()):
        raise ScanError(
            "slices that resemble their neighbours, as those of one scan do",
            f"some that do not: {text} much as the slices around them",
            "give one scan: slices of another one are among these, or many are missing",
        )
    why = "the patient moved, metal, missing slices or those of another scan"
    return (Finding("unlike", f"{text} much as the slices around them: {why}", "warning"),)


def _sure(slices: Int16[np.ndarray, "k n m"], k: int) -> float:
    """From which change on slices k and k + 1 are of two scans; the streaks of metal begin and end at once."""
    near = slices[max(k + 1 - 2 * _AROUND, 0) : k + 1 + 2 * _AROUND]
    metal = float((near > _METAL_HU).mean(axis=(1, 2)).max())
    return _REFUSED_NEAR_METAL if metal > _METAL else _REFUSED


def _block_means(hu: Int16[np.ndarray, "n m"]) -> Float[np.ndarray, "a b"]:
    high, wide = (max(n // _SIDE, 1) for n in hu.shape)
    rows, columns = hu.shape[0] // high, hu.shape[1] // wide
    whole = np.clip(hu[: rows * high, : columns * wide], *_RANGE_HU)
    return np.asarray(whole.reshape(rows, high, columns, wide).mean(axis=(1, 3), dtype=np.float32), dtype=np.float64)


def _check_alternation(means: Float[np.ndarray, "k a b"], first: int, told: Told) -> None:
    """Where every second slice is of another scan, a slice resembles the one after next, for slices on end."""
    one = np.abs(np.diff(means, axis=0)).mean(axis=(1, 2))
    two = np.abs(means[2:] - means[:-2]).mean(axis=(1, 2))
    # A whole run of them, since a single slice of another scan has its neighbours on either side alike as well.
    alike = 2 * two + 1 < _ALTERNATING * (one[1:] + one[:-1] + 1)
    on_end = np.lib.stride_tricks.sliding_window_view(alike, _ALTERNATING_SLICES).all(axis=1)
    found = np.flatnonzero(on_end)
    if len(found):
        k = first + int(found[0])
        raise ScanError(
            "slices that resemble the next one most, as those of one scan do",
            f"two scans that alternate, such as in {told(k)}, {told(k + 1)} and {told(k + 2)}",
            "separate the two scans that are mixed here",
        )


def _jumps(changes: Float[np.ndarray, "g"]) -> Float[np.ndarray, "g"]:
    """Each change in terms of the larger of those before and behind it, for the head begins and ends."""
    usual = float(np.median(changes))
    out = np.empty(len(changes))
    for k in range(len(changes)):
        sides = [side for side in (changes[max(k - _AROUND, 0) : k], changes[k + 1 : k + 1 + _AROUND]) if len(side)]
        around = max(float(np.median(side)) for side in sides)
        out[k] = changes[k] / max(around, usual / 2, 1)
    return out
