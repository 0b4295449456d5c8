"""Where a mesh passes through itself, and how what moved its vertices is taken back until it does not."""

from __future__ import annotations

from itertools import count

import numpy as np
from jaxtyping import Bool, Float, Int, Int32, Int64

from naris.anatomy.crossing_kernels import crossing_in_strips

_MOST = 1_000_000
_STRIP_FACES, _MOST_STRIPS = 2.0, 256  # how many faces wide strips are, and how many there may be
_TURNS_A_RING, _LEAST_SHARE = 2, 0.2


def crossings(
    vertices_mm: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    asked: Bool[np.ndarray, "f"] | None = None,
) -> Int64[np.ndarray, "n 2"]:
    """The pairs of faces that pass through each other or lie on each other, in order; at most a million of them.

    Faces that share vertices cross if they have more in common than those. Touching from one side is no crossing. With
    `asked`, only pairs with one of those faces, which is quicker.
    """
    if not len(faces):
        return np.zeros((0, 2), np.int64)
    corners = np.asarray(vertices_mm, dtype=np.float64)[faces]
    # Along the longest side of the mesh a face lies beside the fewest others.
    axes = np.argsort(-np.ptp(vertices_mm, axis=0), kind="stable")
    a, b, c = (corners[:, k, axes] for k in range(3))
    boxes = np.hstack([np.minimum(np.minimum(a, b), c), np.maximum(np.maximum(a, b), c)])
    order = np.argsort(boxes[:, 0], kind="stable")
    boxes = boxes[order]
    first, start, members = _in_strips(boxes[:, 1], boxes[:, 4])
    ordered = np.ascontiguousarray(corners[order]), np.asarray(faces, np.int64)[order]
    wanted = np.ones(len(faces), bool) if asked is None else asked[order]
    pairs = np.sort(order[crossing_in_strips(*ordered, boxes, first, start, members, wanted, _MOST)], axis=1)
    return np.asarray(pairs[np.lexsort(pairs.T[::-1])])


def uncrossed(
    begin_mm: Float[np.ndarray, "v 3"], end_mm: Float[np.ndarray, "v 3"], faces: Int32[np.ndarray, "f 3"]
) -> Float[np.ndarray, "v 3"]:
    """Vertices moved from one place to another, but so much less around faces that would cross that none do.

    Where they are let alone they lie at the end, bit for bit. What crosses at the beginning already is not mended.
    """
    share, there = np.ones(len(begin_mm)), np.array(end_mm)
    found = crossings(there, faces)
    for turn in count():
        wrong = found[share[faces[found]].any(axis=(1, 2))]  # the others cross at the beginning
        if not len(wrong):
            break
        near = _around(faces, len(share), wrong, 1 + turn // _TURNS_A_RING)
        share[near] = np.where(share[near] > _LEAST_SHARE, share[near] / 2, 0.0)
        there = np.where(share[:, None] < 1, begin_mm + share[:, None] * (end_mm - begin_mm), end_mm)
        moved = near[faces].any(axis=1)
        found = np.concatenate([found[~moved[found].any(axis=1)], crossings(there, faces, moved)])
    return there


def _around(
    faces: Int32[np.ndarray, "f 3"], vertices: int, pairs: Int64[np.ndarray, "n 2"], rings: int
) -> Bool[np.ndarray, "v"]:
    """Which vertices belong to a face of a pair, or lie within so many edges of one that does."""
    near = np.zeros(vertices, dtype=bool)
    near[faces[pairs.ravel()]] = True
    for _ in range(rings):
        near[faces[near[faces].any(axis=1)]] = True
    return near


def _in_strips(
    low_mm: Float[np.ndarray, "f"], high_mm: Float[np.ndarray, "f"]
) -> tuple[Int64[np.ndarray, "f"], Int64[np.ndarray, "s"], Int64[np.ndarray, "e"]]:
    """The first strip that each face reaches into, and the faces of every strip (compressed rows)."""
    size = max(float(high_mm.max() - low_mm.min()), 1e-6)
    width = max(_STRIP_FACES * float(np.mean(high_mm - low_mm)), size / _MOST_STRIPS)
    first, last = (((ends - low_mm.min()) / width).astype(np.int64) for ends in (low_mm, high_mm))
    reach = last - first + 1
    members = np.repeat(np.arange(len(first)), reach)
    strips = first[members] + np.arange(len(members)) - np.repeat(np.cumsum(reach) - reach, reach)
    start = np.append(0, np.cumsum(np.bincount(strips)))
    return first, start, members[np.argsort(strips, kind="stable")]
