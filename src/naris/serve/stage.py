"""What the page of the viewer is given of an anatomy: surface, room, regions, ways in, and the look of its walls."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from scipy.spatial import cKDTree

from naris.anatomy.distance import SPACING_MM, lumen_distance
from naris.core.anatomy import Anatomy, RegionSet
from naris.core.pose import Pose
from naris.render.appearance import ENDOSCOPE, Appearance
from naris.render.look import MUCOSA, RAMP_BLOOD, TONE_REACH, pack
from naris.render.noise import EDGE, STEPS
from naris.report.pictures import css_colour, region_colours
from naris.serve.parcel import parcel

NOWHERE = 255
"""The label of what lies in no region."""
FARTHEST_MM, DEEPEST_MM = 12.0, 1.0
"""Distances are told up to so much, in the air and in tissue, in steps of `STEP_MM`: deep in tissue one is as good as
another, and no place there is a dead end."""
STEP_MM = 0.001
_STRIDE = 2  # of the nodes that regions are told at
_LOOK_AHEAD_MM = 3.0
_LEAST_PLACE_MM = 0.3
_OFF_BORDER_MM = 2.0
_NEAR_MM = 10.0


@dataclass(frozen=True)
class Place:
    """Somewhere to begin at: a landmark or the middle of a region, looking along the way in.

    Attributes:
        name: of the landmark or region.
        kind: `landmark` or `region`.
        anatomy_T_camera: one pose.
    """

    name: str
    kind: str
    anatomy_T_camera: Pose


def surface_parcel(anatomy: Anatomy, regions: RegionSet | None) -> bytes:
    """The surface with the region of each corner, and what the page says of the anatomy.

    `normals` point out of the closed surface, `region` is that of the air in front of a corner.
    """
    vertices, normals = anatomy.vertices_mm, anatomy.vertex_normals
    arrays = {
        "vertices": vertices.astype(np.float32),
        "normals": normals.astype(np.float32),
        "faces": anatomy.faces.astype(np.uint32),
        "region": _labels(regions, anatomy.before_walls_mm()),
    }
    for number, passage in enumerate(anatomy.passages):
        arrays[f"passage{number}"] = passage.points_mm.astype(np.float32)
    names = () if regions is None else regions.names
    about = {
        "name": anatomy.name,
        "digest": anatomy.digest,
        "frame": anatomy.frame,
        "bounds": anatomy.bounds_mm.tolist(),
        "passages": [passage.name for passage in anatomy.passages],
        "landmarks": {name: point.tolist() for name, point in anatomy.landmarks_mm.items()},
        "regions": [
            {"name": name, "colour": css_colour(colour)}
            for name, colour in zip(names, region_colours(names), strict=True)
        ],
        "regionSet": None if regions is None else regions.name,
        "places": _told(places(anatomy, regions)),
        "missing": missing(anatomy, regions),
    }
    return parcel(arrays, about)


def room_parcel(anatomy: Anatomy, regions: RegionSet | None) -> bytes:
    """How far every place is from the wall (positive in the air) and in which region it lies, on grids, z fastest."""
    distance = lumen_distance(anatomy)
    steps = np.clip(distance.values_mm, -DEEPEST_MM, FARTHEST_MM) / STEP_MM
    nodes = np.stack(np.meshgrid(*(axis[::_STRIDE] for axis in distance.nodes_mm), indexing="ij"), axis=-1)
    about = {
        "origin": distance.origin_mm.tolist(),
        "spacing": float(distance.spacing_mm),
        "step": STEP_MM,
        "deepest": DEEPEST_MM,
        "stride": _STRIDE,
        "nowhere": NOWHERE,
    }
    return parcel({"distance": np.rint(steps).astype(np.int16), "region": _labels(regions, nodes)}, about)


def regions_parcel(anatomy: Anatomy, regions: RegionSet, about: dict[str, Any]) -> bytes:
    """The regions alone, as they are in the parcels of the surface and the room, and where each may be entered."""
    nodes = lumen_distance(anatomy).nodes_mm
    grid = np.stack(np.meshgrid(*(axis[::_STRIDE] for axis in nodes), indexing="ij"), axis=-1)
    arrays = {"surface": _labels(regions, anatomy.before_walls_mm()), "room": _labels(regions, grid)}
    return parcel(arrays, {**about, "places": _told(places(anatomy, regions))})


def look_parcel(look: Appearance = ENDOSCOPE) -> bytes:
    """An appearance with a mucosa as the numbers and tables of `naris.render.look`, for the page to draw it alike.

    `tissue` and `relief` are volumes of noise (z, y, x, field), as a texture has them.

    Raises:
        ValueError: if the wall is no mucosa.
    """
    looks = pack([look], 0)
    row = looks.rows[0]
    if row["kind"] != MUCOSA:
        raise ValueError("only a mucosa can be drawn in the page")
    volumes = looks.bank[int(row["bank"])].transpose(0, 3, 2, 1, 4)
    about = {name: float(row[name]) for name in row.dtype.names or ()}
    # Noise repeats, so that a single's precision is not spent on where in it one is.
    about |= {name: about[name] % EDGE for name in about if name[:-2] in ("tissue", "relief") and name[-2] == "_"}
    about |= {"edge": EDGE, "steps": STEPS, "rampBlood": RAMP_BLOOD, "toneReach": TONE_REACH}
    arrays = {
        "tissue": volumes[0].astype(np.int8),
        "relief": volumes[1].astype(np.int8),
        "ramp": looks.ramp[0].astype(np.float32),
        "tone": looks.tone[0].astype(np.float32),
        "spot": looks.spot[0].astype(np.float32),
    }
    return parcel(arrays, about)


def steady(look: Appearance = ENDOSCOPE) -> Appearance:
    """The same without what changes from picture to picture, or with the size of a pixel: noise, blur, sharpening."""
    return look.with_(sensor=replace(look.sensor, read_noise=0.0, shot_noise=0.0, blur_px=0.0, sharpen=0.0))


def places(anatomy: Anatomy, regions: RegionSet | None) -> list[Place]:
    """Where to begin: each landmark within 1 cm of the way, then each region at its widest place on a passage."""
    if not anatomy.passages:
        return []
    passages = sorted(anatomy.passages, key=lambda passage: -passage.length_mm)
    points = np.concatenate([passage.points_mm for passage in passages])
    clearance = np.concatenate([passage.clearance_mm for passage in passages])
    towards = np.concatenate([_ahead(passage.points_mm) for passage in passages])
    roomy = clearance > _LEAST_PLACE_MM
    found = []
    for name, point in anatomy.landmarks_mm.items():
        off = np.linalg.norm(points - point, axis=1) + np.where(roomy, 0.0, np.inf)
        near = int(np.argmin(off))
        if off[near] > _NEAR_MM:
            continue
        found.append(Place(name, "landmark", _looking(anatomy, points[near], towards[near])))
    if regions is not None:
        label = regions.label(points)
        for number, name in enumerate(regions.names):
            here = np.flatnonzero((label == number) & roomy)
            if len(here):
                # In the midst of it: a place at its border is soon in the next one.
                others = points[label != number]
                off = cKDTree(others).query(points[here])[0] if len(others) else np.full(len(here), np.inf)
                midst = here[off >= min(_OFF_BORDER_MM, float(off.max()))]
                widest = midst[int(np.argmax(clearance[midst]))]
                found.append(Place(name, "region", _looking(anatomy, points[widest], towards[widest])))
    return found


def missing(anatomy: Anatomy, regions: RegionSet | None) -> list[str]:
    """What an anatomy has not, and what the page therefore cannot do, in words."""
    told = []
    if regions is None:
        told.append("no regions: naris anatomy transfer carries them over from other noses")
    if not anatomy.passages:
        told.append("no passages: naris anatomy finds them; until then the scope begins in the widest place")
    if not anatomy.landmarks_mm:
        told.append("no landmarks to jump to")
    return told


def start_pose(anatomy: Anatomy) -> Pose:
    """Where the page begins: in the first passage, a little way in; without passages in the widest place."""
    if anatomy.passages:
        line, clearance = anatomy.passages[0].points_mm, anatomy.passages[0].clearance_mm
        inside = np.flatnonzero(clearance > _LEAST_PLACE_MM)
        at = int(inside[min(len(inside) // 8, len(inside) - 1)]) if len(inside) else len(line) // 8
        return _looking(anatomy, line[at], _ahead(line)[at])
    distance = lumen_distance(anatomy)
    node = np.unravel_index(int(np.argmax(distance.values_mm)), distance.values_mm.shape)
    place = distance.origin_mm + distance.spacing_mm * np.array(node, dtype=np.float64)
    return _looking(anatomy, place, np.array([0.0, 1.0, 0.0]))


def _told(places: list[Place]) -> list[dict[str, Any]]:
    return [{"name": one.name, "kind": one.kind, "pose": one.anatomy_T_camera.matrix.tolist()} for one in places]


def _labels(regions: RegionSet | None, points_mm: Float[np.ndarray, "*n 3"]) -> UInt8[np.ndarray, "*n"]:
    if regions is None:
        return np.full(points_mm.shape[:-1], NOWHERE, np.uint8)
    label = regions.label(points_mm)
    return np.where((label >= 0) & (label < NOWHERE), label, NOWHERE).astype(np.uint8)


def _ahead(line_mm: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """The unit direction along a line, over some mm; its points are 0.5 mm apart."""
    n = len(line_mm)
    if n < 2:
        return np.tile([0.0, 1.0, 0.0], (n, 1))
    reach = max(int(_LOOK_AHEAD_MM / SPACING_MM), 1)
    first = np.minimum(np.arange(n), n - 2)
    way = line_mm[np.minimum(first + reach, n - 1)] - line_mm[first]
    return way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)


def _looking(anatomy: Anatomy, place: Float[np.ndarray, "3"], towards: Float[np.ndarray, "3"]) -> Pose:
    up = np.array([0.0, 0.0, 1.0]) if abs(towards[2]) < 0.98 else np.array([0.0, -1.0, 0.0])
    return Pose.look(place, towards, up, anatomy.frame)


def summary(anatomy: Anatomy, regions: RegionSet | None) -> dict[str, Any]:
    """What the command says of what it serves."""
    return {
        "anatomy": anatomy.name,
        "faces": len(anatomy.faces),
        "regions": 0 if regions is None else len(regions.names),
        "passages": len(anatomy.passages),
    }
