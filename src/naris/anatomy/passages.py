"""Passages: centrelines through the lumen, found as minimal paths through the distance field.

A path costs 1/clearance² a millimetre, so it keeps to the middle of the lumen; then it is smoothed. Which paths are
worth having is told by `Route`s or found out: the first passage leads from the opening to the far end, and the next
ones, as in TEASAR (Sato et al., Pacific Graphics 2000), to whatever part of the lumen is furthest from those found.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.spatial import cKDTree

from naris.anatomy.centreline import centreline
from naris.anatomy.distance import SignedDistance, signed_distance
from naris.anatomy.lumen import LumenGraph, Tree, lumen_graph
from naris.core.anatomy import Anatomy, Passage
from naris.errors import PoseError

_END_CLEARANCE_MM = 1.0
_ROOMY_MM = 0.8
_COVERED_MM = 9.0
_MOST_BRANCHES = 6
_SAME_WAY_MM = 1.5
_DEAD_END_MM = 6.0
_AROUND_MM = 5.0, 12.0
_NOSTRIL, _NASOPHARYNX = "nostril", "nasopharynx"


@dataclass(frozen=True, eq=False)
class Route:
    """Where a passage is wanted, in mm in the frame of the anatomy; each point may lie up to 5 mm beside the lumen.

    Attributes:
        name: of the passage.
        start_mm: (3,) outside end, e.g. the nostril.
        end_mm: (3,) inside end, e.g. the nasopharynx.
        via_mm: points to pass on the way, in order.
    """

    name: str
    start_mm: Float[np.ndarray, "3"]
    end_mm: Float[np.ndarray, "3"]
    via_mm: tuple[Float[np.ndarray, "3"], ...] = ()

    @property
    def points_mm(self) -> Float[np.ndarray, "n 3"]:
        """Start, via and end, in order."""
        return np.stack([self.start_mm, *self.via_mm, self.end_mm])


class _Narrow(NamedTuple):
    route: Route
    reason: PoseError


def find_passages(
    anatomy: Anatomy,
    distance: SignedDistance | None = None,
    routes: Sequence[Route] | None = None,
    *,
    finer_mm: float | None = None,
) -> tuple[Passage, ...]:
    """The passages of an anatomy: points 0.5 mm apart, each inside the lumen, ordered from outside to inside.

    With `routes`, one passage each. Without, the landmarks with `nostril` in their name are the openings and the one
    with `nasopharynx` the far end; where there are none, the front and the back of the lumen (along y, as in LPS and
    in the mean nose; for a lumen that hardly extends along y, its two most distant places). Then the passages are
    called `main`, `branch 1`, … or, with the words before `nostril`, `left.main`, `left.branch 1`, …

    With `finer_mm`, a route that ends where the grid is too coarse for the lumen is sought once more, around its points
    on a grid of that spacing, and if need be in the whole lumen on such a grid.

    Raises:
        PoseError: if a point of a route is more than 5 mm away from the lumen, or the lumen is too thin for the grid.
    """
    distance = distance or signed_distance(anatomy)
    graph = lumen_graph(distance)
    if routes is None:
        ways = _ways_found(graph, anatomy.landmarks_mm)
        return tuple(Passage(name, *centreline(graph.points_mm[way], distance)) for name, way in ways.items())
    stops, narrow = _stops(graph, routes)
    if narrow and finer_mm is None:
        raise narrow[0].reason
    found = {
        name: Passage(name, *centreline(graph.points_mm[way], distance))
        for name, way in _ways_through_stops(graph, stops).items()
    }
    for route in (each.route for each in narrow):
        found[route.name] = _finer(anatomy, distance, route, finer_mm or distance.spacing_mm)
    return tuple(found[route.name] for route in routes)


def _finer(anatomy: Anatomy, distance: SignedDistance, route: Route, spacing_mm: float) -> Passage:
    """Around the points of a route; where the way makes a detour, further around them, then in the whole lumen."""
    for margin_mm in _AROUND_MM:
        with suppress(PoseError):
            return find_passages(anatomy, distance.around(route.points_mm, margin_mm, spacing_mm), [route])[0]
    return find_passages(anatomy, distance.around(anatomy.bounds_mm, spacing_mm, spacing_mm), [route])[0]


def _stops(graph: LumenGraph, routes: Sequence[Route]) -> tuple[dict[str, list[int]], list[_Narrow]]:
    """The nodes that each route passes, and the routes that have a point too far from all nodes."""
    stops, narrow = {}, []
    for route in routes:
        try:
            stops[route.name] = [graph.nearest(point) for point in route.points_mm]
        except PoseError as error:
            narrow.append(_Narrow(route, error))
    return stops, narrow


def _ways_through_stops(graph: LumenGraph, stops: dict[str, list[int]]) -> dict[str, Int[np.ndarray, "m"]]:
    legs = {leg for each in stops.values() for leg in pairwise(each)}
    ends = {start: sorted(end for begin, end in legs if begin == start) for start, _ in legs}
    trees = {start: graph.central_tree(start, to) for start, to in ends.items()}
    return {
        name: np.concatenate([each[:1], *(trees[start].way_to(end)[1:] for start, end in pairwise(each))])
        for name, each in stops.items()
    }


def _ways_found(graph: LumenGraph, landmarks_mm: dict[str, Float[np.ndarray, "3"]]) -> dict[str, Int[np.ndarray, "m"]]:
    openings = {_prefix(name): graph.nearest(point) for name, point in landmarks_mm.items() if _NOSTRIL in name}
    far = next((graph.nearest(point) for name, point in landmarks_mm.items() if _NASOPHARYNX in name), None)
    if not openings or far is None:
        openings, far = _two_ends(graph, openings)
    inwards = {prefix: graph.central_tree(node) for prefix, node in openings.items()}
    outwards = graph.central_tree(far)
    apart_mm = {prefix: graph.distance_to(np.array([node])) for prefix, node in openings.items()}
    ways = {f"{prefix}main": tree.way_to(far) for prefix, tree in inwards.items()}
    numbers = dict.fromkeys(inwards, 0)
    for _ in range(_MOST_BRANCHES * len(inwards)):
        tip = _uncovered_tip(graph, np.concatenate(list(ways.values())))
        if tip is None:
            break
        prefix = min(apart_mm, key=lambda name: apart_mm[name][tip])  # by length: a wide way may lead round the septum
        numbers[prefix] += 1
        ways[f"{prefix}branch {numbers[prefix]}"] = _way_through(graph, inwards[prefix], tip, outwards)
    return ways


def _prefix(landmark: str) -> str:
    """`left.` of `left nostril centre` and of `left.nostril`."""
    side = landmark.partition(_NOSTRIL)[0].strip(" .")
    return f"{side}." if side else ""


def _two_ends(graph: LumenGraph, openings: dict[str, int]) -> tuple[dict[str, int], int]:
    """Openings and far end where landmarks do not tell: roomy places at the ends of y, or else the most distant."""
    roomy = graph.clearance_mm >= min(_END_CLEARANCE_MM, float(np.median(graph.clearance_mm)))
    if openings:
        return openings, _furthest(graph, np.array(list(openings.values())), roomy)
    extent_mm = np.ptp(graph.points_mm, axis=0)
    if extent_mm[1] >= 0.5 * extent_mm.max():
        along = graph.points_mm[:, 1]
        return {"": int(np.argmin(np.where(roomy, along, np.inf)))}, int(np.argmax(np.where(roomy, along, -np.inf)))
    one = _furthest(graph, np.array([int(np.argmax(graph.clearance_mm))]), roomy)
    other = _furthest(graph, np.array([one]), roomy)
    first, last = sorted((one, other), key=lambda node: graph.points_mm[node, 1])
    return {"": first}, last


def _furthest(graph: LumenGraph, nodes: Int[np.ndarray, "m"], allowed: Bool[np.ndarray, "n"]) -> int:
    return int(np.argmax(np.where(allowed, graph.distance_to(nodes), -1.0)))


def _uncovered_tip(graph: LumenGraph, covered: Int[np.ndarray, "m"]) -> int | None:
    """The roomy place furthest from the ways so far, unless all are near."""
    off_mm = graph.distance_to(covered)
    tip = int(np.argmax(np.where(graph.clearance_mm >= _ROOMY_MM, off_mm, -1.0)))
    return tip if off_mm[tip] > _COVERED_MM else None


def _way_through(graph: LumenGraph, inwards: Tree, tip: int, outwards: Tree) -> Int[np.ndarray, "m"]:
    """From the opening to the tip, and on to the far end unless that means to turn back."""
    there, onwards = inwards.way_to(tip), outwards.way_to(tip)[::-1]
    nearest, _ = cKDTree(graph.points_mm[there]).query(graph.points_mm[onwards])
    back = np.flatnonzero(nearest > _SAME_WAY_MM)
    steps = np.linalg.norm(np.diff(graph.points_mm[onwards], axis=0), axis=1)
    turned_mm = float(steps[: back[0]].sum()) if len(back) else np.inf
    return there if turned_mm > _DEAD_END_MM else np.append(there, onwards[1:])
