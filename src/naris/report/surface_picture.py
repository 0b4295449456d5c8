"""A surface drawn as tinted glass, its regions in colour, without perspective: the picture of regions on the anatomy.

A small rasteriser keeps the nearest layers of every pixel (a k-buffer, Bavoil et al. 2007), shades each by how
much the wall turns away from the eye, and blends them back to front. Points are placed on the picture by the same
`Aspect`, so that lines drawn over it meet the surface.
"""

from __future__ import annotations

from dataclasses import dataclass

import numba
import numpy as np
from jaxtyping import Float, Float32, Int, Int32, UInt8

from naris.core.anatomy import NOWHERE, Anatomy, Between, RegionSet

_LAYERS = 8
_OFF_WALL_MM = (0.0, 0.4, 0.9, 1.6, 2.5)
_GREY = np.array([0.55, 0.57, 0.60], dtype=np.float32)


@dataclass(frozen=True)
class Aspect:
    """From where a surface is seen: unit axes of the picture in the frame of the anatomy.

    Attributes:
        name: what a reader calls it, e.g. `from the left`.
        right: direction that points to the right in the picture.
        up: direction that points upwards in the picture.
    """

    name: str
    right: tuple[float, float, float]
    up: tuple[float, float, float]

    @property
    def towards_eye(self) -> Float[np.ndarray, "3"]:
        """The direction out of the picture."""
        return np.cross(np.array(self.right, dtype=np.float64), np.array(self.up, dtype=np.float64))

    def flatten(self, points_mm: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 2"]:
        """Where points stand in the picture: mm to the right, mm downwards."""
        points_mm = np.asarray(points_mm, dtype=np.float64)
        return np.stack([points_mm @ np.array(self.right), -(points_mm @ np.array(self.up))], axis=-1)


FROM_LEFT = Aspect("from the left", right=(0, 1, 0), up=(0, 0, 1))
FROM_FRONT = Aspect("from the front", right=(1, 0, 0), up=(0, 0, 1))
FROM_ABOVE = Aspect("from above", right=(0, 1, 0), up=(-1, 0, 0))
"""The three aspects in the LPS axes (x left, y posterior, z superior); side and top share their horizontal axis."""


@dataclass(frozen=True, eq=False)
class SurfacePicture:
    """A drawn surface.

    Attributes:
        rgba: (H, W, 4) uint8, not premultiplied; transparent beside the surface.
        corner_mm: (2,) where the outer corner at the top left stands, in the mm of `Aspect.flatten`.
        px_per_mm: pixels a mm.
    """

    rgba: UInt8[np.ndarray, "h w 4"]
    corner_mm: Float[np.ndarray, "2"]
    px_per_mm: float


def draw_surface(
    anatomy: Anatomy,
    regions: RegionSet | None,
    colours: UInt8[np.ndarray, "k 3"],
    aspect: Aspect,
    px_per_mm: float = 16.0,
) -> SurfacePicture:
    """Draws the surface of an anatomy, each point in the colour of the region that it bounds.

    `colours` holds one sRGB colour a region; without regions, or where the wall bounds none, it is grey. Edges are
    not smoothed: draw at twice the size at which the picture is shown.
    """
    flat = aspect.flatten(anatomy.vertices_mm)
    corner = np.floor(flat.min(axis=0)) - 0.5
    width, height = np.ceil((flat.max(axis=0) + 0.5 - corner) * px_per_mm).astype(int)
    xyd = np.concatenate([(flat - corner) * px_per_mm - 0.5, (anatomy.vertices_mm @ aspect.towards_eye)[:, None]], 1)
    faces, places = _k_buffer(xyd.astype(np.float32), anatomy.faces, np.array([height, width, _LAYERS]))
    picture = np.zeros((height, width, 4), dtype=np.float32)
    for layer in range(_LAYERS):  # the farthest comes first
        hit = np.nonzero(faces[..., layer] >= 0)
        if not len(hit[0]):
            continue
        corners = anatomy.faces[faces[(*hit, layer)]]
        points = _carry(anatomy.vertices_mm, corners, places[(*hit, layer)])
        normals = _carry(anatomy.vertex_normals, corners, places[(*hit, layer)])
        normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-9)
        into_air = normals if isinstance(anatomy.airspace, Between) else -normals
        _blend(picture, hit, _shade(_tint(points, into_air, regions, colours), normals, aspect))
    alpha = picture[..., 3:]
    picture[..., :3] /= np.maximum(alpha, 1e-6)
    return SurfacePicture(np.rint(255 * np.clip(picture, 0, 1)).astype(np.uint8), corner, px_per_mm)


def _carry(
    values: Float[np.ndarray, "v 3"], corners: Int32[np.ndarray, "n 3"], places: Float32[np.ndarray, "n 2"]
) -> Float32[np.ndarray, "n 3"]:
    """Values at the vertices of triangles carried to places inside them (weights of the first two corners)."""
    values = values.astype(np.float32)
    a, b, c = (values[corners[:, i]] for i in range(3))
    return c + places[:, :1] * (a - c) + places[:, 1:] * (b - c)


def _tint(
    points_mm: Float32[np.ndarray, "n 3"],
    into_air: Float32[np.ndarray, "n 3"],
    regions: RegionSet | None,
    colours: UInt8[np.ndarray, "k 3"],
) -> Float32[np.ndarray, "n 3"]:
    """The colour of the region beside the wall: walls themselves often lie on the edge of the labelled space."""
    if regions is None:
        return np.broadcast_to(_GREY, points_mm.shape)
    label = np.full(len(points_mm), NOWHERE, dtype=np.intp)
    for off_mm in _OFF_WALL_MM:
        open_ = np.nonzero(label == NOWHERE)[0]
        if not len(open_):
            break
        label[open_] = regions.label(points_mm[open_] + off_mm * into_air[open_])
    palette = np.concatenate([colours.astype(np.float32) / 255, _GREY[None]])
    return palette[label]  # NOWHERE = −1 is the grey at the end


def _shade(
    tint: Float32[np.ndarray, "n 3"], normals: Float32[np.ndarray, "n 3"], aspect: Aspect
) -> Float32[np.ndarray, "n 4"]:
    """Glass: nearly clear where the wall faces the eye, denser where it turns away; lit from above the eye."""
    facing = np.abs(normals @ aspect.towards_eye.astype(np.float32))
    light = aspect.towards_eye + 0.6 * np.array(aspect.up) - 0.3 * np.array(aspect.right)
    lit = np.abs(normals @ (light / np.linalg.norm(light)).astype(np.float32))
    alpha = 0.2 + 0.6 * (1 - facing) ** 2.2
    gloss = 0.35 * lit**16
    colour = np.clip(tint * (0.5 + 0.55 * lit)[:, None] + gloss[:, None], 0, 1)
    return np.concatenate([colour, alpha[:, None]], axis=1).astype(np.float32)


def _blend(
    picture: Float32[np.ndarray, "h w 4"],
    hit: tuple[np.ndarray, ...],
    shade: Float32[np.ndarray, "n 4"],
) -> None:
    """Porter and Duff's *over* in premultiplied colours, in place."""
    alpha = shade[:, 3:]
    under = picture[hit]
    picture[hit] = np.concatenate([shade[:, :3] * alpha, alpha], axis=1) + under * (1 - alpha)


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _k_buffer(
    xyd: Float32[np.ndarray, "v 3"], faces: Int32[np.ndarray, "f 3"], size: Int[np.ndarray, "3"]
) -> tuple[Int32[np.ndarray, "h w k"], Float32[np.ndarray, "h w k 2"]]:
    """The nearest layers of every pixel, the farthest of them first: the face (−1 none), and the place in it.

    `xyd` are pixels and depth towards the eye; a place is the weights of the first two corners.
    """
    height, width, k = size
    deep = np.full((height, width, k), -np.inf, dtype=np.float32)
    face = np.full((height, width, k), -1, dtype=np.int32)
    place = np.zeros((height, width, k, 2), dtype=np.float32)
    for f in range(len(faces)):
        a, b, c = xyd[faces[f, 0]], xyd[faces[f, 1]], xyd[faces[f, 2]]
        area = (b[0] - a[0]) * (c[1] - a[1]) - (c[0] - a[0]) * (b[1] - a[1])
        if abs(area) < 1e-9:
            continue
        x0 = max(int(np.ceil(min(a[0], b[0], c[0]))), 0)
        x1 = min(int(np.floor(max(a[0], b[0], c[0]))), width - 1)
        y0 = max(int(np.ceil(min(a[1], b[1], c[1]))), 0)
        y1 = min(int(np.floor(max(a[1], b[1], c[1]))), height - 1)
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                u = ((b[0] - x) * (c[1] - y) - (c[0] - x) * (b[1] - y)) / area
                v = ((c[0] - x) * (a[1] - y) - (a[0] - x) * (c[1] - y)) / area
                z = u * a[2] + v * b[2] + (1 - u - v) * c[2]
                if u < 0 or v < 0 or u + v > 1 or z <= deep[y, x, 0]:
                    continue
                slot = 0
                while slot + 1 < k and z > deep[y, x, slot + 1]:
                    deep[y, x, slot] = deep[y, x, slot + 1]
                    face[y, x, slot] = face[y, x, slot + 1]
                    place[y, x, slot] = place[y, x, slot + 1]
                    slot += 1
                deep[y, x, slot] = z
                face[y, x, slot] = f
                place[y, x, slot, 0] = u
                place[y, x, slot, 1] = v
    return face, place
