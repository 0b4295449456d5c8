"""The regions on the anatomy: the surface as glass from three sides, with passages, trajectories and a scale."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from naris.anatomy import mean_nose
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
    "training": ("training", "cameras on training trajectories"),
    "test": ("test", "cameras on test trajectories"),
    "passage": ("passage", "passages"),
}
_FOLD_PX = 0.25
_JOINED_MM = 3.0
"""Cameras further apart are not joined: a straight line between them could lead through a wall."""


def anatomy_figure(view: AnatomyView) -> Markup:
    """The surface from the left, the front and above, laid out like an engineering drawing, with its legend."""
    colours = region_colours(view.regions.names)
    lines = _lines(view)
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


def anatomy_caption(view: AnatomyView) -> str:
    """What is to be seen in the figure, and nothing else."""
    roles, frame = {line.role for line in _lines(view)}, view.anatomy.frame
    said = [
        f"The walls of the hollow as if of glass, in the colours of its regions (the set “{view.region_set}”), seen "
        "from the left, from the front and from above.",
    ]
    if roles & {"training", "test"}:
        said.append(
            "Every dot is a place where a camera stood; two that follow each other on one way are joined if they are "
            f"at most {_JOINED_MM:g}\u00a0mm apart."
        )
    if "passage" in roles:
        said.append("The dashed lines run along the middle of the passages.")
    if isinstance(view.regions, SlabRegions) and any(_borders_cross(view.regions, aspect) for aspect in _ASPECTS):
        axis = "xyz"[view.regions.axis]
        said.append(f"The dotted lines are the borders of the regions; above them stands their {axis} in mm.")
    said.append(f"Directions: {_directions(frame)}.")
    if frame == "LPS":
        said.append("The patient’s left is on the right in the view from the front, and below in the view from above.")
    return " ".join(said)


def _directions(frame: str) -> str:
    """Where the axes of a frame point, as far as that is known."""
    if frame == "LPS":
        return "x points to the left of the patient, y backwards, z upwards"
    if frame == mean_nose.FRAME:
        return "y points from the nostril back to the nasopharynx, z upwards; one side of a nose, in nobody’s head"
    return (
        f"axes of the frame “{frame}” as the file has them, drawn as if x pointed to the left, y backwards, z upwards"
    )


def _lines(view: AnatomyView) -> tuple[Line, ...]:
    return view.lines or tuple(Line(p.name, "passage", p.points_mm) for p in view.anatomy.passages)


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
        label(float(corner[0]), float(corner[1]) - (10 if aspect is FROM_ABOVE else 32), aspect.name, "start", "group"),
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
        parts += _way(line, (aspect.flatten(line.points_mm) - shot.corner_mm) * px_per_mm + corner)
    return join(parts)


def _way(line: Line, at_px: Float[np.ndarray, "n 2"]) -> list[Markup]:
    """A passage as a dashed line; cameras as dots, joined where they follow each other closely."""
    pieces, spots = [at_px], ""
    if line.role != "passage":
        far = np.linalg.norm(np.diff(line.points_mm, axis=0), axis=1) > _JOINED_MM
        pieces = np.split(at_px, np.flatnonzero(far) + 1)
        spots = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in at_px)
    parts = []
    for piece in (piece for piece in pieces if len(piece) > 1):
        path = " ".join(f"{x:.1f},{y:.1f}" for x, y in _thinned(piece))
        parts += [element("polyline", points=path, class_=class_) for class_ in ("halo", f"way {line.role}")]
    if spots:
        parts += [element("path", d=spots, class_=f"spot {class_}") for class_ in ("halo", line.role)]
    return parts


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
    if not isinstance(regions, SlabRegions) or not _borders_cross(regions, aspect):
        return []
    parts = []
    for border_mm in regions.borders_mm:
        x = float(corner[0] + (border_mm * aspect.right[regions.axis] - shot.corner_mm[0]) * px_per_mm)
        y = float(corner[1])
        parts.append(element("line", x1=x, x2=x, y1=y - 4, y2=y + float(height), class_="border"))
        if aspect is not FROM_ABOVE:  # there they are those of the view from the left, right above it
            parts.append(label(x, y - 10, f"{'xyz'[regions.axis]} = {round(border_mm, 1):g}".replace("-", "−")))
    return parts


def _borders_cross(regions: SlabRegions, aspect: Aspect) -> bool:
    """Whether the borders are upright lines in the picture."""
    return abs(aspect.right[regions.axis]) == 1


def _scale_bar(x: float, y: float, px_per_mm: float) -> Markup:
    end = float(x + 10 * px_per_mm)
    return join(
        element("line", x1=float(x), x2=end, y1=float(y), y2=float(y), class_="scalebar"),
        label((float(x) + end) / 2, float(y) - 8, "10 mm"),
    )
