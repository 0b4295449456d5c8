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

from naris.core.anatomy import NOWHERE, Anatomy, RegionSet

_LAYERS = 8
_OVERSAMPLING = 2
_INWARD_MM = (0.0, 0.4, 0.9, 1.6, 2.5)
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
        return np.cross(self.right, self.up)

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
    px_per_mm: float = 8.0,
) -> SurfacePicture:
    """Draws the surface of an anatomy, each point in the colour of the region that it bounds.

    `colours` holds one sRGB colour a region; without regions, or where the wall bounds none, it is grey.
    """
    scale = px_per_mm * _OVERSAMPLING
    flat = aspect.flatten(anatomy.vertices_mm)
    corner = np.floor(flat.min(axis=0)) - 0.5
    size = np.ceil((flat.max(axis=0) + 0.5 - corner) * px_per_mm).astype(int) * _OVERSAMPLING
    depth_mm = anatomy.vertices_mm @ aspect.towards_eye
    layers, faces = _k_buffer(
        ((flat - corner) * scale - 0.5).astype(np.float32),
        depth_mm.astype(np.float32),
        anatomy.faces,
        np.array([size[1], size[0], _LAYERS]),
    )
    picture = np.zeros((size[1], size[0], 4), dtype=np.float32)
    for layer in range(_LAYERS):  # the farthest comes first
        hit = np.nonzero(faces[..., layer] >= 0)
        if not len(hit[0]):
            continue
        at = np.stack([hit[1], hit[0]], axis=-1) / scale + corner + 0.5 / scale
        points = _unflatten(at, layers[(*hit, layer)], aspect)
        normals = _smooth_normals(anatomy, faces[(*hit, layer)], points)
        tint = _tint(points, normals, regions, colours)
        _blend(picture, hit, _shade(tint, normals, aspect))
    return SurfacePicture(_shrink(picture), corner, px_per_mm)


def _unflatten(
    flat_mm: Float[np.ndarray, "n 2"], depth_mm: Float32[np.ndarray, "n"], aspect: Aspect
) -> Float[np.ndarray, "n 3"]:
    axes = np.stack([np.array(aspect.right, float), -np.array(aspect.up, float), aspect.towards_eye])
    return np.concatenate([flat_mm, depth_mm[:, None]], axis=1) @ axes


def _smooth_normals(
    anatomy: Anatomy, faces: Int32[np.ndarray, "n"], points_mm: Float[np.ndarray, "n 3"]
) -> Float[np.ndarray, "n 3"]:
    """Vertex normals carried to points of the faces by areas of the opposite triangles."""
    corners = anatomy.faces[faces]
    a, b, c = (anatomy.vertices_mm[corners[:, i]] for i in range(3))
    normal = np.cross(b - a, c - a)
    area2 = np.maximum((normal * normal).sum(axis=1), 1e-20)
    weight_a = (np.cross(c - b, points_mm - b) * normal).sum(axis=1) / area2
    weight_b = (np.cross(a - c, points_mm - c) * normal).sum(axis=1) / area2
    weights = np.clip(np.stack([weight_a, weight_b, 1 - weight_a - weight_b], axis=1), 0, 1)
    blended = np.einsum("nk,nkd->nd", weights, anatomy.vertex_normals[corners])
    return blended / np.maximum(np.linalg.norm(blended, axis=1, keepdims=True), 1e-9)


def _tint(
    points_mm: Float[np.ndarray, "n 3"],
    normals: Float[np.ndarray, "n 3"],
    regions: RegionSet | None,
    colours: UInt8[np.ndarray, "k 3"],
) -> Float32[np.ndarray, "n 3"]:
    """The colour of the region just inside the wall: walls themselves often lie on the edge of the labelled space."""
    if regions is None:
        return np.broadcast_to(_GREY, points_mm.shape)
    label = np.full(len(points_mm), NOWHERE, dtype=np.intp)
    for inward_mm in _INWARD_MM:
        open_ = np.nonzero(label == NOWHERE)[0]
        if not len(open_):
            break
        label[open_] = regions.label(points_mm[open_] - inward_mm * normals[open_])
    palette = np.concatenate([colours.astype(np.float32) / 255, _GREY[None]])
    return palette[label]  # NOWHERE = −1 is the grey at the end


def _shade(
    tint: Float32[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], aspect: Aspect
) -> Float32[np.ndarray, "n 4"]:
    """Glass: nearly clear where the wall faces the eye, denser where it turns away; lit from above the eye."""
    facing = np.abs(normals @ aspect.towards_eye)
    light = aspect.towards_eye + 0.6 * np.array(aspect.up) - 0.3 * np.array(aspect.right)
    lit = np.abs(normals @ (light / np.linalg.norm(light)))
    alpha = 0.2 + 0.6 * (1 - facing) ** 2.2
    gloss = 0.35 * lit**24
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


def _shrink(picture: Float32[np.ndarray, "h w 4"]) -> UInt8[np.ndarray, "h2 w2 4"]:
    height, width = (n // _OVERSAMPLING for n in picture.shape[:2])
    mean = picture.reshape(height, _OVERSAMPLING, width, _OVERSAMPLING, 4).mean(axis=(1, 3))
    alpha = mean[..., 3:]
    colour = np.where(alpha > 0, mean[..., :3] / np.maximum(alpha, 1e-6), 0)
    return np.rint(255 * np.clip(np.concatenate([colour, alpha], axis=-1), 0, 1)).astype(np.uint8)


@numba.njit(cache=True, nogil=True)  # type: ignore[untyped-decorator]
def _k_buffer(
    xy: Float32[np.ndarray, "v 2"],
    depth: Float32[np.ndarray, "v"],
    faces: Int32[np.ndarray, "f 3"],
    size: Int[np.ndarray, "3"],
) -> tuple[Float32[np.ndarray, "h w k"], Int32[np.ndarray, "h w k"]]:
    """The nearest layers of every pixel, the farthest of them first: depth towards the eye, and the face (−1 none)."""
    height, width, k = size
    deep = np.full((height, width, k), -np.inf, dtype=np.float32)
    face = np.full((height, width, k), -1, dtype=np.int32)
    for f in range(len(faces)):
        a, b, c = faces[f]
        area = (xy[b, 0] - xy[a, 0]) * (xy[c, 1] - xy[a, 1]) - (xy[c, 0] - xy[a, 0]) * (xy[b, 1] - xy[a, 1])
        if abs(area) < 1e-9:
            continue
        x0 = max(int(np.ceil(min(xy[a, 0], xy[b, 0], xy[c, 0]))), 0)
        x1 = min(int(np.floor(max(xy[a, 0], xy[b, 0], xy[c, 0]))), width - 1)
        y0 = max(int(np.ceil(min(xy[a, 1], xy[b, 1], xy[c, 1]))), 0)
        y1 = min(int(np.floor(max(xy[a, 1], xy[b, 1], xy[c, 1]))), height - 1)
        for y in range(y0, y1 + 1):
            for x in range(x0, x1 + 1):
                u = ((xy[b, 0] - x) * (xy[c, 1] - y) - (xy[c, 0] - x) * (xy[b, 1] - y)) / area
                v = ((xy[c, 0] - x) * (xy[a, 1] - y) - (xy[a, 0] - x) * (xy[c, 1] - y)) / area
                w = 1 - u - v
                if u < 0 or v < 0 or w < 0:
                    continue
                z = u * depth[a] + v * depth[b] + w * depth[c]
                if z <= deep[y, x, 0]:
                    continue
                slot = 0
                while slot + 1 < k and z > deep[y, x, slot + 1]:
                    deep[y, x, slot] = deep[y, x, slot + 1]
                    face[y, x, slot] = face[y, x, slot + 1]
                    slot += 1
                deep[y, x, slot] = z
                face[y, x, slot] = f
    return deep, face
