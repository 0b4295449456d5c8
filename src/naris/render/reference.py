"""The numpy engine: rays through `embreex`, shading in numpy. Slow, readable, and the fall-back of the fast engine."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Float32, Int, Int32, UInt8

from naris.core.anatomy import Anatomy
from naris.errors import EngineUnavailable
from naris.render.geometry import geometry_of
from naris.render.look import LIT_VERTICES, VERTEX_COLOURS, Looks, pack
from naris.render.rays import RayTable, ray_table
from naris.render.scene import Rendering, Shot
from naris.render.shading import Hits, develop, dot, light_vertices, optics_weight, radiance, turned, unit

_MOST_LAYERS = 64
_STEP = 1e-5
"""How far behind a culled wall the ray goes on: this share of the way, and so many mm."""


class NumpyEngine:
    """Frame by frame on one thread.

    Raises:
        EngineUnavailable: if `embreex` cannot be loaded.
    """

    name = "numpy"

    def __init__(self, anatomy: Anatomy) -> None:
        self.geometry = geometry_of(anatomy)
        self._scene = public_scene(self.geometry.vertices_mm, self.geometry.faces)

    def render(self, shot: Shot) -> Rendering:
        """All frames of a shot."""
        looks = pack(shot.appearances, len(self.geometry.vertices_mm))
        rays = ray_table(shot.intrinsics)
        frames = [self._frame(shot, i, looks, rays) for i in range(len(shot))]
        size = (len(shot), shot.intrinsics.height, shot.intrinsics.width)

        def stacked(name: str, *tail: int, dtype: type) -> np.ndarray:
            return np.array([f[name] for f in frames], dtype).reshape(*size, *tail)

        return Rendering(
            stacked("valid", dtype=bool),
            stacked("rgb", 3, dtype=np.uint8) if "rgb" in shot.want else None,
            stacked("depth", dtype=np.float32) if "depth" in shot.want else None,
            stacked("normal", 3, dtype=np.float32) if "normal" in shot.want else None,
            stacked("face_id", dtype=np.int32) if "face_id" in shot.want else None,
        )

    def _frame(self, shot: Shot, i: int, looks: Looks, rays: RayTable) -> dict[str, np.ndarray]:
        rotation, position = shot.rotation[i], shot.position_mm[i]
        world = turned(rays.directions, rotation)
        face, distance, uv = self._trace(position, world, bool(looks.rows[i]["cull"]))
        seen = rays.exists & (face >= 0)
        face = np.where(seen, face, -1).astype(np.int32)
        flat = self.geometry.face_normals[face] * seen[:, None]
        away = np.where(dot(flat, world)[:, None] > 0, np.float32(-1), np.float32(1))
        out: dict[str, np.ndarray] = {"valid": seen, "face_id": face}
        out["depth"] = np.where(seen, distance * rays.directions[:, 2], 0)
        out["normal"] = turned(flat * away, rotation.T)
        if "rgb" in shot.want:
            at = np.flatnonzero(seen)
            hits = self._hits(looks, i, shot, (at, face[at], distance[at], uv[at], away[at], world[at]))
            out["rgb"] = self._picture(shot, i, looks, at, hits)
        return out

    def _trace(
        self, origin: Float32[np.ndarray, "3"], directions: Float32[np.ndarray, "n 3"], cull: bool
    ) -> tuple[Int32[np.ndarray, "n"], Float32[np.ndarray, "n"], Float32[np.ndarray, "n 2"]]:
        """Face (−1 for none), distance, and (u, v) of the nearest hit; with `cull` of the nearest from its outside."""
        n = len(directions)
        face, distance, uv = np.full(n, -1, np.int32), np.zeros(n, np.float32), np.zeros((n, 2), np.float32)
        active, start = np.arange(n), np.zeros(n, np.float32)
        for _ in range(_MOST_LAYERS if cull else 1):
            origins = origin + start[active, None] * directions[active]
            hit = self._scene.run(origins, directions[active], output=True)
            found = np.where(hit["geomID"] >= 0, hit["primID"], -1)
            total = start[active] + hit["tfar"]
            culled = np.zeros(len(found), np.bool_)
            if cull:
                culled = (found >= 0) & (dot(self.geometry.face_normals[found], directions[active]) > 0)
            keep = (found >= 0) & ~culled
            at = active[keep]
            face[at], distance[at] = found[keep], total[keep]
            uv[at] = np.stack([hit["u"], hit["v"]], axis=-1)[keep]
            active = active[culled]
            if not len(active):
                break
            start[active] = total[culled] * np.float32(1 + _STEP) + np.float32(_STEP)
        return face, distance, uv

    def _hits(self, looks: Looks, i: int, shot: Shot, found: tuple[np.ndarray, ...]) -> Hits:
        _, face, distance, uv, away, world = found
        corners = self.geometry.faces[face]
        weights = np.stack([1 - uv[:, 0] - uv[:, 1], uv[:, 0], uv[:, 1]], axis=-1)
        normal = unit(_between(self.geometry.vertex_normals, corners, weights))
        row = looks.rows[i]
        base = np.zeros_like(world)
        if row["kind"] == VERTEX_COLOURS:
            base = _between(looks.colours[row["colours"]], corners, weights)
        if row["kind"] == LIT_VERTICES:
            lit = self._lit(looks, i, shot)
            inside = (away[:, 0] < 0).astype(np.intp)[:, None] * lit.shape[1]
            base = _between(lit.reshape(-1, 3), corners + inside, weights)
        point = shot.position_mm[i] + distance[:, None] * world
        pixel = distance * np.float32(ray_table(shot.intrinsics).pixel_rad)
        return Hits(point, -world, distance, (normal * away).astype(np.float32), base.astype(np.float32), pixel)

    def _lit(self, looks: Looks, i: int, shot: Shot) -> Float32[np.ndarray, "2 v 3"]:
        place = _light_place(shot, i, looks)
        return light_vertices(self.geometry.vertices_mm, self.geometry.vertex_normals, looks, i, *place)

    def _picture(self, shot: Shot, i: int, looks: Looks, at: np.ndarray, hits: Hits) -> UInt8[np.ndarray, "h w 3"]:
        size = (shot.intrinsics.height, shot.intrinsics.width)
        light = np.zeros((size[0] * size[1], 3), np.float32)
        light[at] = radiance(hits, looks, i, *_light_place(shot, i, looks))
        weight = optics_weight(looks, i, *size)
        return develop(light.reshape(*size, 3) * weight[..., None], weight, looks, i, int(shot.seeds[i]))


def _between(
    values: Float32[np.ndarray, "v 3"], corners: Int[np.ndarray, "m 3"], weights: Float32[np.ndarray, "m 3"]
) -> Float32[np.ndarray, "m 3"]:
    """Values of the vertices between the three corners of each face."""
    a, b, c = (weights[:, k, None] * values[corners[:, k]] for k in range(3))
    return a + b + c


def _light_place(shot: Shot, i: int, looks: Looks) -> tuple[Float32[np.ndarray, "3"], Float32[np.ndarray, "3"]]:
    """Position and axis of the light of frame i in the anatomy's frame."""
    row = looks.rows[i]
    offset = np.array([row["light_x"], row["light_y"], row["light_z"]], np.float32)
    return shot.position_mm[i] + shot.rotation[i] @ offset, shot.rotation[i][:, 2]


def public_scene(vertices_mm: Float32[np.ndarray, "v 3"], faces: Int32[np.ndarray, "f 3"]) -> Any:
    """The surface in `embreex`.

    Raises:
        EngineUnavailable: if `embreex` cannot be loaded.
    """
    try:
        from embreex import rtcore_scene
        from embreex.mesh_construction import TriangleMesh
    except ImportError as error:
        raise EngineUnavailable("the package embreex", f"{error}", "install embreex for this platform") from error
    scene = rtcore_scene.EmbreeScene()
    TriangleMesh(scene, vertices_mm, faces.astype(np.uint32))
    return scene
