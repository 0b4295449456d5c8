"""Closes small tunnels and cuts thin bridges of a lumen, where walls that are uneven happen to touch.

A part of a grid (air, or tissue) is grown from its thickest place outwards, the thickest nodes first, and only by nodes
that do not change its topology (simple points; Bertrand, Malandain 1994, Pattern Recognit Lett 15:169). What is left
are cuts across its handles, where it is thinnest: those across air plug tunnels, those across tissue cut bridges.
"""
# ruff: noqa: ANN001, ANN202
# mypy: disable-error-code="no-untyped-def, no-untyped-call, untyped-decorator"

from __future__ import annotations

import heapq

import numpy as np
from jaxtyping import Bool
from numba import njit
from scipy import ndimage

from naris.anatomy.level_set import Field, only_lumen, surface

_MOST_MM3 = 8.0
"""The largest cut that is made: larger ones would change a nose more than they mend."""
_HALF_MM = 0.7
_AROUND_NODES = 3
_PLACES = np.stack(np.meshgrid(*[range(-1, 2)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
_STEPS = np.abs(_PLACES).sum(axis=1)
_APART = np.abs(_PLACES[:, None] - _PLACES[None])
_POWERS = 1 << np.arange(27, dtype=np.int64)
_FACES = int(_POWERS[_STEPS == 1].sum())
_NEAR = int(_POWERS[(_STEPS == 1) | (_STEPS == 2)].sum())
_ALL = int(_POWERS[_STEPS > 0].sum())
_BY_FACES = ((_APART.sum(axis=2) == 1) * _POWERS).sum(axis=1)
_BY_CORNERS = ((_APART.max(axis=2) == 1) * _POWERS).sum(axis=1)


def without_small_handles(field: Field, spacing_mm: float) -> Field:
    """The field, positive in the lumen, with fewer handles; the very same where its surface has none.

    A plug or a gap is 1.4 mm thick. Handles whose cuts are large stay: they are anatomy, or need other parameters.
    """
    genus = _genus(field)
    for sign in (1, -1):
        if genus == 0:
            break
        mended = only_lumen(_cut(field, sign, spacing_mm))
        left = _genus(mended)
        if left < genus:
            field, genus = mended, left
    return field


def _genus(field: Field) -> int:
    """Handles of the surface in one piece."""
    vertices, faces = surface(field, np.zeros(3), 1.0)
    return 1 - (len(vertices) - len(faces) // 2) // 2


def _cut(field: Field, sign: int, spacing_mm: float) -> Field:
    """The field with the small cuts across its air (sign 1) or its tissue (sign −1) made into the other."""
    part = sign * field > 0
    signed = sign * field
    labels, count = ndimage.label(_cuts(part, _seed(part, signed, sign), signed), np.ones((3, 3, 3)))
    sizes_mm3 = np.bincount(labels.ravel(), minlength=count + 1) * spacing_mm**3
    for number, box in enumerate(ndimage.find_objects(labels), start=1):
        if sizes_mm3[number] <= _MOST_MM3:
            wide = tuple(slice(max(s.start - _AROUND_NODES, 0), s.stop + _AROUND_NODES) for s in box)
            away_mm = ndimage.distance_transform_edt(labels[wide] != number, sampling=spacing_mm)
            signed[wide] = np.minimum(signed[wide], (away_mm - _HALF_MM).astype(np.float32))
    return sign * signed


def _cuts(
    part: Bool[np.ndarray, "nx ny nz"], seed: Bool[np.ndarray, "nx ny nz"], depth_mm: Field
) -> Bool[np.ndarray, "nx ny nz"]:
    """Nodes of a part of the grid that close its handles, a node thick; it is grown from a seed that has none."""
    grown = np.pad(seed, 1, mode="edge")
    _grow(np.pad(part, 1), np.pad(depth_mm, 1), grown, _BY_FACES, _BY_CORNERS)
    return part & ~grown[1:-1, 1:-1, 1:-1]


def _seed(part: Bool[np.ndarray, "nx ny nz"], depth_mm: Field, sign: int) -> Bool[np.ndarray, "nx ny nz"]:
    """Where to begin: the deepest node of the air; of the tissue, all that lies outside boxes around the air."""
    if sign > 0:
        seed = np.zeros(part.shape, dtype=bool)
        seed[np.unravel_index(int(depth_mm.argmax()), part.shape)] = True
        return seed
    # Neighbouring boxes overlap, so together they are a ball, and what lies outside is a shell.
    from_side, from_below = np.asarray((~part).any(axis=2)), np.asarray((~part).any(axis=0)).T
    return ~(_between(from_side)[:, :, None] & _between(from_below).T[None])


def _between(hit: Bool[np.ndarray, "n ny"]) -> Bool[np.ndarray, "n ny"]:
    """From the first to the last that is hit in each column."""
    return np.logical_or.accumulate(hit, axis=0) & np.logical_or.accumulate(hit[::-1], axis=0)[::-1]


@njit(cache=True, nogil=True)
def _grow(part, depth_mm, grown, by_faces, by_corners):
    """Grows in place by simple points of the part (joined by faces; the rest by corners), the deepest first."""
    nx, ny, nz = part.shape
    waits = np.zeros(part.shape, np.bool_)
    heap = [(np.float32(0), 0, 0, 0)]
    heap.pop()
    for i in range(1, nx - 1):
        for j in range(1, ny - 1):
            for k in range(1, nz - 1):
                if part[i, j, k] and not grown[i, j, k] and _around(grown, i, j, k) & _FACES:
                    waits[i, j, k] = True
                    heapq.heappush(heap, (-depth_mm[i, j, k], i, j, k))
    while len(heap):
        _, i, j, k = heapq.heappop(heap)
        waits[i, j, k] = False
        beside = _around(grown, i, j, k)
        if not _once(beside & _NEAR, _FACES, by_faces) or not _once(~beside & _ALL, _ALL, by_corners):
            continue
        grown[i, j, k] = True
        for x in range(max(i - 1, 1), min(i + 2, nx - 1)):
            for y in range(max(j - 1, 1), min(j + 2, ny - 1)):
                for z in range(max(k - 1, 1), min(k + 2, nz - 1)):
                    if part[x, y, z] and not grown[x, y, z] and not waits[x, y, z]:
                        waits[x, y, z] = True
                        heapq.heappush(heap, (-depth_mm[x, y, z], x, y, z))


@njit(cache=True, nogil=True)
def _around(grown, i, j, k):
    """The 27 nodes around one as bits, the last axis fastest."""
    bits = 0
    place = 0
    for x in range(i - 1, i + 2):
        for y in range(j - 1, j + 2):
            for z in range(k - 1, k + 2):
                if grown[x, y, z]:
                    bits |= 1 << place
                place += 1
    return bits


@njit(cache=True, nogil=True)
def _once(bits, starts, joined):
    """Whether exactly one connected piece of the nodes in `bits` has a node among `starts`."""
    left, pieces = bits, 0
    for first in range(27):
        if not (left & starts) >> first & 1:
            continue
        pieces += 1
        if pieces > 1:
            return False
        front = 1 << first
        left &= ~front
        while front:
            reached = 0
            for place in range(27):
                if front >> place & 1:
                    reached |= joined[place]
            front = reached & left
            left &= ~front
    return pieces == 1
