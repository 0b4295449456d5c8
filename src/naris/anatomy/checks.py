"""Is a mesh a surface that a lumen can have: closed, wound one way, in one piece, free of crossings, in millimetres?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from naris.anatomy.crossings import crossings

UNITS_MM = {"mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4, "um": 0.001}
"""Millimetres in one of each unit."""

# The longest side of what endoscopes look into, from one turbinate to a whole head.
_SMALLEST_MM, _LARGEST_MM = 15.0, 600.0


@dataclass(frozen=True, eq=False)
class SurfaceReport:
    """What was found in a mesh; lengths in mm of the mesh as given.

    Attributes:
        vertices, faces: how many.
        closed: every edge is passed as often one way as the other, so that the mesh has an inside.
        open_edges: edges that are passed more often one way than the other.
        one_way: False where the mesh would be closed if only its faces were wound the same way.
        pieces: connected pieces, the largest (by volume) first.
        piece_volumes_ml: signed volume of each; negative where it is wound inside out.
        genus: handles of the largest piece; None where it is not closed or not a manifold.
        bounds_mm: (2, 3) low and high corner.
        unit: the unit of the numbers, as far as the extent tells: see `unit_by_extent`.
        crossings: pairs of faces that pass through each other; None where nobody asked.
        crossing_faces: how many faces are in such pairs.
    """

    vertices: int
    faces: int
    closed: bool
    open_edges: int
    one_way: bool
    pieces: int
    piece_volumes_ml: Float[np.ndarray, "p"]
    genus: int | None
    bounds_mm: Float[np.ndarray, "2 3"]
    unit: str
    crossings: int | None = None
    crossing_faces: int | None = None

    @property
    def volume_ml(self) -> float:
        """Signed volume; negative if the surface is inside out."""
        return float(self.piece_volumes_ml.sum())

    @property
    def inside_out(self) -> bool:
        return self.volume_ml < 0

    @property
    def longest_mm(self) -> float:
        return float(np.ptp(self.bounds_mm, axis=0).max())


def check_surface(
    vertices_mm: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], *, find_crossings: bool = False
) -> SurfaceReport:
    """Looks a mesh over; refuses nothing (`read_surface` does).

    Args:
        vertices_mm: corners; every one should be used by a face.
        faces: three indices each.
        find_crossings: look for faces that pass through each other, too; quick for a surface of small faces, endless
            for heaps of large ones.
    """
    wrong = crossings(vertices_mm, faces) if find_crossings else None
    balance, uses = _edges(len(vertices_mm), faces)
    piece = pieces_of(len(vertices_mm), faces)
    volumes = piece_volumes_ml(vertices_mm, faces, piece)
    order = np.argsort(-np.abs(volumes), kind="stable")
    closed = not balance.any()
    manifold = closed and bool((uses == 2).all())
    bounds = np.stack([vertices_mm.min(axis=0), vertices_mm.max(axis=0)])
    return SurfaceReport(
        vertices=len(vertices_mm),
        faces=len(faces),
        closed=closed,
        open_edges=int(np.count_nonzero(balance)),
        one_way=closed or bool((uses % 2 == 1).any()),
        pieces=len(volumes),
        piece_volumes_ml=volumes[order],
        genus=_genus(faces, faces_of_piece(faces, piece, int(order[0]))) if manifold else None,
        bounds_mm=bounds,
        unit=unit_by_extent(float(np.ptp(bounds, axis=0).max())),
        crossings=None if wrong is None else len(wrong),
        crossing_faces=None if wrong is None else len(np.unique(wrong)),
    )


def unit_by_extent(longest: float) -> str:
    """The unit in which a surface of this longest side is as large as a nose or a head (15 to 600 mm).

    `mm` if that will do; else whichever of m, in, cm and um would, joined by ` or `; else `unknown`.
    """
    likely = [unit for unit, size in UNITS_MM.items() if _SMALLEST_MM <= longest * size <= _LARGEST_MM]
    return "mm" if "mm" in likely else " or ".join(likely) or "unknown"


def pieces_of(vertices: int, faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "v"]:
    """The number of the connected piece that each vertex belongs to (unused vertices: a piece each)."""
    rows, columns = faces[:, [0, 1]].T
    more_rows, more_columns = faces[:, [1, 2]].T
    ends = np.append(rows, more_rows), np.append(columns, more_columns)
    graph = coo_array((np.ones(len(ends[0]), dtype=np.int8), ends), shape=(vertices, vertices))
    _, piece = connected_components(graph, directed=False)
    return piece


def faces_of_piece(faces: Int[np.ndarray, "f 3"], piece: Int[np.ndarray, "v"], number: int) -> Bool[np.ndarray, "f"]:
    """Which faces belong to one piece."""
    return piece[faces[:, 0]] == number


def piece_volumes_ml(
    vertices_mm: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], piece: Int[np.ndarray, "v"]
) -> Float[np.ndarray, "p"]:
    """The signed volume of each connected piece (see `pieces_of`)."""
    # About the middle of the mesh, so that far-away coordinates cost no digits.
    a, b, c = (vertices_mm[faces[:, k]] - vertices_mm.mean(axis=0) for k in range(3))
    tetrahedra = (a * np.cross(b, c)).sum(axis=1) / 6000.0
    return np.bincount(piece[faces[:, 0]], weights=tetrahedra, minlength=int(piece.max()) + 1)


def wound_one_way(faces: Int[np.ndarray, "f 3"]) -> Int[np.ndarray, "f 3"]:
    """The same faces, wound so that neighbours agree; for a mesh whose edges have two faces each.

    Every piece keeps the winding of its first face.
    """
    partner, same_way = _neighbours(faces)
    flip = np.zeros(len(faces), dtype=bool)
    seen = np.zeros(len(faces), dtype=bool)
    for first in range(len(faces)):
        if seen[first]:
            continue
        front = np.array([first])
        seen[first] = True
        while len(front):
            nearby = partner[front].ravel()
            turn = (flip[front][:, None] ^ same_way[front]).ravel()
            nearby, index = np.unique(nearby, return_index=True)
            fresh = ~seen[nearby]
            front = nearby[fresh]
            flip[front] = turn[index][fresh]
            seen[front] = True
    return np.where(flip[:, None], faces[:, ::-1], faces)


def _edges(vertices: int, faces: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, "e"], Int[np.ndarray, "e"]]:
    """For each edge, passes one way less those the other way, and all passes."""
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    keys = np.minimum(start, end).astype(np.int64) * vertices + np.maximum(start, end)
    _, number = np.unique(keys, return_inverse=True)
    balance = np.bincount(number, weights=np.sign(end.astype(np.int64) - start)).astype(np.int64)
    return balance, np.bincount(number)


def _neighbours(faces: Int[np.ndarray, "f 3"]) -> tuple[Int[np.ndarray, "f 3"], Bool[np.ndarray, "f 3"]]:
    """The face across each edge, and whether both pass the edge the same way (so that one must be flipped)."""
    start, end = faces.ravel().astype(np.int64), np.roll(faces, -1, axis=1).ravel().astype(np.int64)
    order = np.lexsort((np.maximum(start, end), np.minimum(start, end)))
    across = np.empty_like(order)
    across[order[0::2]], across[order[1::2]] = order[1::2], order[0::2]
    return (across // 3).reshape(-1, 3), (start[across] == start).reshape(-1, 3)


def _genus(faces: Int[np.ndarray, "f 3"], members: Bool[np.ndarray, "f"]) -> int:
    """By Euler's formula V − E + F = 2 − 2g of a closed manifold, whose edges have two faces each."""
    count = int(members.sum())
    return (2 - (len(np.unique(faces[members])) - 3 * count // 2 + count)) // 2
