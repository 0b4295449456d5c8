"""The regions on the anatomy: the surface as glass from three sides, with passages, trajectories and a scale."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from naris.core.anatomy import SlabRegions
from naris.report.data import AnatomyView, Line
from naris.report.markup import Markup, element, join
from naris.report.pictures import css_colour, data_uri, region_colours
from naris.report.plot import drawing, label, legend
from naris.report.surface_picture import FROM_ABOVE, FROM_FRONT, FROM_LEFT, Aspect, SurfacePicture, draw_surface

_WIDTH = 960
_GAP, _TOP = 34, 50
_SHARPNESS = 1.9
_OVERLAYS: dict[str, tuple[str, str]] = {
    "training": ("training", "training trajectories"),
    "test": ("test", "test trajectories"),
    "passage": ("passage", "passages (centrelines)"),
}
_FOLD_PX = 0.25
_JUMP = 3


def anatomy_figure(view: AnatomyView) -> Markup:
    """The surface from the left, the front and above, laid out like an engineering drawing, with its legend."""
    colours = region_colours(view.regions.names)
    lines = view.lines or tuple(Line(p.name, "passage", p.points_mm) for p in view.anatomy.passages)
    extent = np.ptp(view.anatomy.bounds_mm, axis=0)
    px_per_mm = (_WIDTH - 3 * _GAP) / (extent[0] + extent[1] + 4)
    shots = [draw_surface(view.anatomy, view.regions, colours, a, _SHARPNESS * px_per_mm) for a in _ASPECTS]
    sizes = [np.array(shot.rgba.shape[1::-1]) / shot.px_per_mm * px_per_mm for shot in shots]
    left = np.array([_GAP / 2, _TOP])
    corners = [left, left + [sizes[0][0] + _GAP, 0], left + [0, sizes[0][1] + _GAP + 8]]
    height = int(corners[2][1] + sizes[2][1] + 8)
    parts = [
        _panel(view, lines, aspect, shot, corner, px_per_mm)
        for aspect, shot, corner in zip(_ASPECTS, shots, corners, strict=True)
    ]
    parts.append(_scale_bar(corners[1][0], height - 24, px_per_mm))
    names = ", ".join(view.regions.names)
    alt = f"{view.anatomy.name} from the left, the front and above, with its regions in colour: {names}"
    chips = [_chip(css_colour(c), name) for c, name in zip(colours, view.regions.names, strict=True)]
    roles = {line.role for line in lines}
    return join(
        drawing(_WIDTH, height, alt, join(parts), "chart anatomy"),
        element("p", chips, class_="legend"),
        legend([entry for role, entry in _OVERLAYS.items() if role in roles]),
    )


_ASPECTS = (FROM_LEFT, FROM_FRONT, FROM_ABOVE)


def _chip(colour: str, text: str) -> Markup:
    return element("span", element("i", class_="swatch", style=f"background:{colour}"), text)


def _panel(
    view: AnatomyView,
    lines: Sequence[Line],
    aspect: Aspect,
    shot: SurfacePicture,
    corner: Float[np.ndarray, "2"],
    px_per_mm: float,
) -> Markup:
    height, width = (n / shot.px_per_mm * px_per_mm for n in shot.rgba.shape[:2])
    parts = [
        label(float(corner[0]), float(corner[1]) - (32 if aspect is FROM_LEFT else 10), aspect.name, "start", "group"),
        element(
            "image",
            href=data_uri(shot.rgba, 2000, 84),
            x=float(corner[0]),
            y=float(corner[1]),
            width=float(width),
            height=float(height),
        ),
    ]
    parts += _borders(view, aspect, shot, corner, px_per_mm, height)
    for line in sorted(lines, key=lambda line: list(_OVERLAYS).index(line.role), reverse=True):
        for piece_mm in _pieces(line.points_mm):
            at = (aspect.flatten(piece_mm) - shot.corner_mm) * px_per_mm + corner
            path = " ".join(f"{x:.1f},{y:.1f}" for x, y in _thinned(at))
            parts.append(element("polyline", points=path, class_="halo"))
            parts.append(element("polyline", points=path, class_=f"way {line.role}"))
    return join(parts)


def _pieces(points_mm: Float[np.ndarray, "n 3"]) -> list[Float[np.ndarray, "_ 3"]]:
    """The line cut where it jumps: where a step is more than three times the usual one."""
    steps = np.linalg.norm(np.diff(points_mm, axis=0), axis=1)
    if not len(steps):
        return [points_mm]
    return np.split(points_mm, np.flatnonzero(steps > _JUMP * np.median(steps)) + 1)


def _thinned(path_px: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "m 2"]:
    """The path without the points that lie within a quarter of a pixel of the straight way (Douglas and Peucker)."""
    if len(path_px) < 3:
        return path_px
    from skimage.measure import approximate_polygon

    return approximate_polygon(path_px, _FOLD_PX)


def _borders(
    view: AnatomyView,
    aspect: Aspect,
    shot: SurfacePicture,
    corner: Float[np.ndarray, "2"],
    px_per_mm: float,
    height: float,
) -> list[Markup]:
    """Where slabs across the horizontal axis of the picture meet, with their coordinate."""
    regions = view.regions
    if not isinstance(regions, SlabRegions) or abs(aspect.right[regions.axis]) != 1:
        return []
    parts = []
    for border_mm in regions.borders_mm:
        x = float(corner[0] + (border_mm * aspect.right[regions.axis] - shot.corner_mm[0]) * px_per_mm)
        y = float(corner[1])
        parts.append(element("line", x1=x, x2=x, y1=y - 4, y2=y + float(height), class_="border"))
        if aspect is FROM_LEFT:
            parts.append(label(x, y - 10, f"{'xyz'[regions.axis]} = {border_mm:g}".replace("-", "−")))
    return parts


def _scale_bar(x: float, y: float, px_per_mm: float) -> Markup:
    end = float(x + 10 * px_per_mm)
    return join(
        element("line", x1=float(x), x2=end, y1=float(y), y2=float(y), class_="scalebar"),
        label((float(x) + end) / 2, float(y) - 8, "10 mm"),
    )
