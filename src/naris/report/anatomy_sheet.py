"""Cuts through an anatomy and views down its passages: what a person looks at before an anatomy is used."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import cast

import cv2
import numpy as np
from jaxtyping import Float, UInt8
from scipy.ndimage import map_coordinates
from scipy.spatial import cKDTree

from naris.airway.block import Block
from naris.anatomy.distance import SignedDistance, lumen_distance
from naris.core.anatomy import Anatomy, Passage, RegionSet
from naris.core.camera import Intrinsics
from naris.core.pose import Pose
from naris.render.appearance import ENDOSCOPE
from naris.render.directions import tangents, upright
from naris.render.scene import Scene, render
from naris.report.markup import Child, Markup, element, figure, join
from naris.report.pictures import picture, region_colours

SHARES = (0.125, 0.375, 0.625, 0.875)
"""Of a passage's own way, where its views are taken."""

_PIXEL_MM = 0.2
_MARGIN_MM = 9.0
_WINDOW_HU = (-1000.0, 600.0)
_AIR, _TISSUE = 40, 150
_TINT = 0.75
_CONTOUR = (255, 90, 40)
_NEARBY = 0.03  # of a passage's own way, within which the roomiest place is taken
_SHARED_MM = 1.5  # two passages that run so near to each other show the same
_LEAST_OWN_MM = 10.0  # on less of a way there are no four places that differ
_LEAST_ROOM_MM = 0.5
_CAMERA = Intrinsics.from_vertical_fov(176, 176, 75.0)
_MOST_PASSAGES = 16


@dataclass(frozen=True, eq=False)
class Cut:
    """A plane through an anatomy.

    Attributes:
        name: such as `axial, z = −9 mm`.
        image: (h, w, 3) RGB. The patient's left is on the right; in a sagittal cut the front is on the left.
    """

    name: str
    image: UInt8[np.ndarray, "h w 3"]


@dataclass(frozen=True, eq=False)
class Down:
    """What is seen down a passage.

    Attributes:
        passage: its name.
        captions: how far in each view is taken.
        images: (N, h, w, 3) RGB.
    """

    passage: str
    captions: tuple[str, ...]
    images: UInt8[np.ndarray, "n h w 3"]


def cuts(
    anatomy: Anatomy,
    regions: RegionSet,
    scan: Block | None = None,
    through_mm: Float[np.ndarray, "3"] | None = None,
) -> tuple[Cut, Cut, Cut]:
    """An axial, a coronal and a sagittal cut, with the wall as a contour.

    Args:
        anatomy: in a frame whose axes are x to the left, y backwards and z upwards.
        regions: whose colours the lumen has.
        scan: the CT behind it; without one, air is dark and tissue is grey.
        through_mm: where the cuts meet; None for the middle of the passages.
    """
    distance = lumen_distance(anatomy)
    at = _middle(anatomy) if through_mm is None else through_mm
    return (
        Cut(f"axial, z = {at[2]:.0f} mm", _plane(anatomy, distance, regions, scan, (0, 1), at, up=False)),
        Cut(f"coronal, y = {at[1]:.0f} mm", _plane(anatomy, distance, regions, scan, (0, 2), at, up=True)),
        Cut(f"sagittal, x = {at[0]:.0f} mm", _plane(anatomy, distance, regions, scan, (1, 2), at, up=True)),
    )


def views_down(anatomy: Anatomy) -> tuple[Down, ...]:
    """Four views down each passage, along it, spread so that they differ.

    What a camera sees changes as it moves by the distance to the walls, so places are spread by length over clearance;
    where a passage runs with one before it, it shows nothing new.
    """
    scene = Scene(anatomy)
    shown = anatomy.passages[:_MOST_PASSAGES]
    return tuple(_down(scene, passage, view_places(passage, shown[:i])) for i, passage in enumerate(shown))


def view_places(passage: Passage, before: Sequence[Passage] = ()) -> list[int]:
    """Which points of a passage its views are taken from: the roomiest around `SHARES` of its own way.

    Args:
        passage: to look down.
        before: those that have been looked down.
    """
    steps_mm = np.linalg.norm(np.diff(passage.points_mm, axis=0), axis=1)
    seen = [other.points_mm for other in before]
    if seen:
        far_mm, _ = cKDTree(np.concatenate(seen)).query(passage.points_mm[1:])
        own_mm = np.where(far_mm > _SHARED_MM, steps_mm, 0.0)
        steps_mm = own_mm if own_mm.sum() >= _LEAST_OWN_MM else steps_mm
    room_mm = np.maximum(passage.clearance_mm, _LEAST_ROOM_MM)
    way = np.concatenate([[0.0], np.cumsum(steps_mm / np.minimum(room_mm[1:], room_mm[:-1]))])
    places = []
    for share in SHARES:
        off = np.abs(way - share * way[-1])
        near = np.flatnonzero(off <= max(_NEARBY * float(way[-1]), float(off.min())))
        places.append(int(near[passage.clearance_mm[near].argmax()]))
    return places


def sheet(anatomy: Anatomy, regions: RegionSet, scan: Block | None = None) -> Markup:
    """The cuts and the views as figures of a page."""
    shown: list[Child] = [
        element("figure", picture(cut.image, f"{cut.name} of {anatomy.name}", 640), element("figcaption", cut.name))
        for cut in cuts(anatomy, regions, scan)
    ]
    behind = "on the scan" if scan is not None else "air dark, tissue grey, as no CT is kept beside it"
    told = f"Cuts through the middle of the passages, {behind}: the wall as a line, the regions in their colours."
    if anatomy.frame == "LPS":
        told += " The patient’s left is on the right; in the sagittal cut the front is on the left."
    parts = [element("section", figure(element("div", shown, class_="row"), told, "wide"))]
    rows = [_row(down) for down in views_down(anatomy)]
    if rows:
        caption = "Down each passage, upright, as an endoscope of 75° would see it; the mucosa is made up."
        if len(rows) > 1:
            caption += " Where passages share a way, the first of them shows it."
        parts.append(element("section", figure(rows, caption, "wide")))
    return join(parts)


def _row(down: Down) -> Markup:
    shown = [
        picture(image, f"{down.passage}, {said}", 176) for image, said in zip(down.images, down.captions, strict=True)
    ]
    return element(
        "div",
        element("div", element("h4", down.passage), element("p", " · ".join(down.captions), class_="small")),
        element("div", shown, class_="strip"),
        class_="views",
    )


def _middle(anatomy: Anatomy) -> Float[np.ndarray, "3"]:
    """Where the cuts meet: the middle of the passages' points, on one side of a nose with two."""
    if not anatomy.passages:
        return anatomy.bounds_mm.mean(axis=0)
    points = np.concatenate([passage.points_mm for passage in anatomy.passages])
    left = [passage.points_mm for passage in anatomy.passages if passage.name.startswith("left.")]
    middle = np.median(points, axis=0)
    if left:
        of_side = np.concatenate(left)
        near = np.abs(of_side[:, 1] - middle[1]) < 10
        middle[0] = np.median(of_side[near if near.any() else slice(None), 0])
    return middle


def _plane(
    anatomy: Anatomy,
    distance: SignedDistance,
    regions: RegionSet,
    scan: Block | None,
    axes: tuple[int, int],
    at_mm: Float[np.ndarray, "3"],
    *,
    up: bool,
) -> UInt8[np.ndarray, "h w 3"]:
    """One cut: the first axis to the right, the second one down, or up."""
    low, high = anatomy.bounds_mm + np.array([[-_MARGIN_MM], [_MARGIN_MM]])
    across, along = (np.arange(low[axis], high[axis], _PIXEL_MM) for axis in axes)
    along = along[::-1] if up else along
    points = np.broadcast_to(at_mm, (len(along), len(across), 3)).copy()
    points[..., axes[0]], points[..., axes[1]] = across[None], along[:, None]
    clearance = distance(points)
    grey = np.where(clearance > 0, _AIR, _TISSUE).astype(np.float64) if scan is None else _grey(scan, points)
    rgb = np.repeat(grey[..., None], 3, axis=2)
    label = regions.label(points)
    inside = (clearance > 0) & (label >= 0)
    colours = region_colours(tuple(regions.names)).astype(np.float64)
    rgb[inside] = (1 - _TINT) * rgb[inside] + _TINT * colours[label[inside]]
    image = np.ascontiguousarray(np.clip(rgb, 0, 255).astype(np.uint8))
    edges, _ = cv2.findContours((clearance > 0).astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
    cv2.polylines(image, edges, isClosed=True, color=_CONTOUR, thickness=1, lineType=cv2.LINE_AA)
    return image


def _grey(scan: Block, points_mm: Float[np.ndarray, "h w 3"]) -> Float[np.ndarray, "h w"]:
    at = np.moveaxis((points_mm - scan.origin_mm) / scan.step_mm, -1, 0)
    hu = map_coordinates(scan.hu, at, order=1, mode="constant", cval=_WINDOW_HU[0])
    low, high = _WINDOW_HU
    return np.asarray(np.clip((hu - low) / (high - low), 0, 1) * 255)


def _down(scene: Scene, passage: Passage, chosen: list[int]) -> Down:
    reach = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(passage.points_mm, axis=0), axis=1))])
    forward = tangents(passage)[chosen]
    poses = Pose.look(passage.points_mm[chosen], forward, upright(forward), scene.anatomy.frame)
    rendering = render(scene, poses, _CAMERA, ENDOSCOPE, want=("rgb",))
    captions = tuple(f"{reach[i]:.0f} mm in".replace(" ", "\N{NO-BREAK SPACE}") for i in chosen)
    return Down(passage.name, captions, cast(np.ndarray, rendering.rgb))
