"""The lumen as a graph: the nodes of the distance grid that lie inside, joined where a straight way is surely free."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import connected_components, dijkstra

from naris.anatomy.distance import SignedDistance
from naris.errors import PoseError

_STEPS = np.array([step for step in itertools.product((-1, 0, 1), repeat=3) if step > (0, 0, 0)])
_LIMITS = (3.0, 12.0, np.inf)  # of the cost: most ways between neighbouring stops in a nose are below the second


@dataclass(frozen=True, eq=False)
class Tree:
    """Shortest ways from one node to all others.

    Attributes:
        source: the node where all ways begin.
        cost: (N,) of the way to each node, infinite where there is none.
        before: (N,) the node before each on its way, negative at the source.
    """

    source: int
    cost: Float[np.ndarray, "n"]
    before: Int[np.ndarray, "n"]

    def way_to(self, node: int) -> Int[np.ndarray, "m"]:
        """The nodes from the source to `node`, both included."""
        way = [node]
        while way[-1] != self.source:
            way.append(int(self.before[way[-1]]))
        return np.array(way[::-1])


@dataclass(frozen=True, eq=False)
class LumenGraph:
    """Nodes of a distance grid inside the lumen (its largest connected part); make it with `lumen_graph`.

    Two of the 26 neighbours are joined where the free balls around them (radius = clearance) touch: then the straight
    way between them cannot cross a wall, however thin.

    Attributes:
        points_mm: (N, 3) where the nodes lie.
        clearance_mm: (N,) distance to the wall.
        ends: (E, 2) the two nodes of each edge.
        length_mm: (E,) of each edge.
    """

    points_mm: Float[np.ndarray, "n 3"]
    clearance_mm: Float[np.ndarray, "n"]
    ends: Int[np.ndarray, "e 2"]
    length_mm: Float[np.ndarray, "e"]

    def central_tree(self, source: int, to: Sequence[int] | None = None) -> Tree:
        """Cheapest ways when a millimetre costs 1/clearance²: they keep to the middle of the lumen.

        Args:
            source: where they begin.
            to: the nodes that they have to lead to, where others do not matter: then the search ends earlier.
        """
        for limit in (np.inf,) if to is None else _LIMITS:
            cost, before = dijkstra(
                self._central, directed=False, indices=source, return_predecessors=True, limit=limit
            )
            if to is None or np.isfinite(cost[list(to)]).all():
                break
        return Tree(source, cost, before)

    def distance_to(self, nodes: Int[np.ndarray, "m"]) -> Float[np.ndarray, "n"]:
        """How far each node is, in mm through the lumen, from the nearest of some."""
        return dijkstra(self._lengths, directed=False, indices=np.unique(nodes), min_only=True)

    def nearest(self, point_mm: Float[np.ndarray, "3"], within_mm: float = 5.0) -> int:
        """The node near a point (mm) in the frame of the grid; among those at hand, one with some clearance.

        Raises:
            PoseError: if the lumen is further than `within_mm` away.
        """
        point = np.asarray(point_mm, dtype=np.float64)
        away = np.linalg.norm(self.points_mm - point, axis=1)
        if not away.min() <= within_mm:
            raise PoseError(
                f"a point within {within_mm:g} mm of the lumen",
                f"{np.round(point, 1).tolist()}, {away.min():.1f} mm away",
                "check the landmark and its frame",
            )
        return int(np.argmin(away - np.minimum(self.clearance_mm, 1.0)))

    @cached_property
    def _central(self) -> csr_array:
        inverse_square = self.clearance_mm**-2
        return self._matrix(self.length_mm * 0.5 * (inverse_square[self.ends[:, 0]] + inverse_square[self.ends[:, 1]]))

    @cached_property
    def _lengths(self) -> csr_array:
        return self._matrix(self.length_mm)

    def _matrix(self, weights: Float[np.ndarray, "e"]) -> csr_array:
        count = len(self.points_mm)
        return csr_array((weights, (self.ends[:, 0], self.ends[:, 1])), shape=(count, count))


def lumen_graph(distance: SignedDistance) -> LumenGraph:
    """The graph of the largest connected part of the lumen.

    Raises:
        PoseError: if no node of the grid lies in the lumen.
    """
    values = distance.values_mm
    inside = np.argwhere(values[1:-1, 1:-1, 1:-1] > 0) + 1
    if not len(inside):
        raise PoseError(
            "a lumen wider than the distance grid",
            f"none at a spacing of {distance.spacing_mm:g} mm",
            "take a finer spacing or check the unit of the surface",
        )
    number = np.full(values.shape, -1, dtype=np.int64)
    number[tuple(inside.T)] = np.arange(len(inside))
    clearance = values[tuple(inside.T)].astype(np.float64)
    ends, lengths = [], []
    for step in _STEPS:
        # The outermost nodes of the grid are left out, so a step never leaves it.
        other = number[tuple((inside + step).T)]
        length = distance.spacing_mm * float(np.linalg.norm(step))
        free = (other >= 0) & (clearance + clearance[other] >= length)
        ends.append(np.stack([np.flatnonzero(free), other[free]], axis=1))
        lengths.append(np.full(free.sum(), length))
    points = distance.origin_mm + distance.spacing_mm * inside
    return _largest_part(LumenGraph(points, clearance, np.concatenate(ends), np.concatenate(lengths)))


def _largest_part(graph: LumenGraph) -> LumenGraph:
    _, label = connected_components(graph._lengths, directed=False)
    keep = label == np.argmax(np.bincount(label))
    number = np.cumsum(keep) - 1
    edges = keep[graph.ends[:, 0]]
    return LumenGraph(
        graph.points_mm[keep], graph.clearance_mm[keep], number[graph.ends[edges]], graph.length_mm[edges]
    )
