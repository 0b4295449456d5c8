"""The fast engine: frames spread over threads, each rendered whole by the compiled kernel.

Every frame is worked off by one thread and depends on nothing but its own pose, appearance and seed, so that the
pictures are the same for any number of threads and any batch.
"""

from __future__ import annotations

import ctypes
import itertools
import threading
from functools import lru_cache

import numpy as np
from jaxtyping import Float32

from naris.core.anatomy import Anatomy
from naris.core.camera import Intrinsics
from naris.core.cores import pool
from naris.render.develop import PAD
from naris.render.embree import ARGUMENTS, PacketScene, library
from naris.render.geometry import geometry_of
from naris.render.kernel import BLOCK, Camera, Outputs, Scratch, Surface, Tables, render_frames
from naris.render.lanes import LANES
from naris.render.look import pack
from naris.render.packets import PACKET_FIELDS, Embree, Packet
from naris.render.rays import ray_table
from naris.render.scene import Rendering, Shot
from naris.render.shading import METER_BINS
from naris.render.sources import OF_PACKETS, sources_of

_ALIGNMENT = 64
_MODULES = (
    *OF_PACKETS,
    *(f"naris.render.{name}" for name in ("develop", "kernel", "look", "noise", "shading", "wall")),
)
_local = threading.local()


class FastEngine:
    """Embree packets shaded in compiled code.

    Raises:
        EngineUnavailable: if the library in `embreex` cannot be used.
    """

    name = "fast"

    def __init__(self, anatomy: Anatomy) -> None:
        geometry = geometry_of(anatomy)
        self._scene = PacketScene(geometry.vertices_mm, geometry.faces)
        found = library()
        self._embree = Embree(found.intersect, self._scene.address, ctypes.addressof(ARGUMENTS), found.width)
        self._vertices = len(geometry.vertices_mm)
        self._surface = Surface(
            geometry.faces,
            geometry.face_normals,
            geometry.vertex_normals[geometry.faces].reshape(-1, 9),
            _planes(np.concatenate([geometry.vertices_mm, geometry.vertex_normals], axis=1)),
            np.zeros((1, 3, 1), np.float32),
        )

    def render(self, shot: Shot) -> Rendering:
        """All frames of a shot."""
        looks = pack(shot.appearances, self._vertices)
        surface = self._surface._replace(colours=np.stack([_planes(c) for c in looks.colours]))
        tables = Tables(
            looks.rows,
            np.ascontiguousarray(looks.ramp.swapaxes(1, 2)),
            looks.tone,
            looks.spot,
            looks.bank.view(np.int32)[..., 0],
        )
        camera, out = _camera(shot.intrinsics), _outputs(shot)
        poses = (np.ascontiguousarray(shot.rotation), np.ascontiguousarray(shot.position_mm))
        seeds = (shot.seeds.astype(np.int64) & 0xFFFFFFFF).astype(np.uint32).view(np.int32)
        sources = _sources()

        def work(piece: tuple[int, int]) -> None:
            scratch = _scratch(camera, surface.vertices.shape[1])
            render_frames(self._embree, camera, surface, poses, tables, seeds, piece, out, scratch, sources)

        pieces = _pieces(len(shot), shot.threads)
        list(map(work, pieces) if len(pieces) <= 1 else pool(shot.threads).map(work, pieces))
        return _as_pictures(out, shot)


def _planes(rows: Float32[np.ndarray, "v c"]) -> Float32[np.ndarray, "c v16"]:
    """Columns one after the other, padded to whole vectors."""
    out = np.zeros((rows.shape[1], -(-len(rows) // LANES) * LANES), np.float32)
    out[:, : len(rows)] = rows.T
    return out


@lru_cache(maxsize=1)
def _sources() -> np.ndarray:
    return sources_of(*_MODULES)


def _pieces(frames: int, threads: int) -> list[tuple[int, int]]:
    """Runs of frames, a few for each thread, so that an easy run does not leave its thread idle."""
    count = 1 if threads == 1 else min(frames, 4 * threads)
    edges = np.linspace(0, frames, count + 1).astype(int).tolist()
    return [(a, b) for a, b in itertools.pairwise(edges) if b > a]


@lru_cache(maxsize=16)
def _camera(intrinsics: Intrinsics) -> Camera:
    """The rays of a camera in blocks of 4×4 pixels."""
    rays = ray_table(intrinsics)
    height, width = intrinsics.height, intrinsics.width
    rows, columns = -(-height // BLOCK) * BLOCK, -(-width // BLOCK) * BLOCK
    index = np.full((rows, columns), -1)
    index[:height, :width] = np.arange(height * width).reshape(height, width)
    pixel = index.reshape(rows // BLOCK, BLOCK, columns // BLOCK, BLOCK).swapaxes(1, 2).ravel()
    valid = aligned(len(pixel), np.int32)
    valid[:] = -1 * ((pixel >= 0) & rays.exists[pixel])
    x, y, z = np.ascontiguousarray(rays.directions[pixel].T)
    inside = np.arange(LANES)
    return Camera(
        x,
        y,
        z,
        valid,
        (inside % BLOCK).astype(np.float32),
        (inside // BLOCK).astype(np.float32),
        np.float32(rays.pixel_rad),
        height,
        width,
        -(-width // LANES) * LANES + 2 * PAD,
    )


def _outputs(shot: Shot) -> Outputs:
    pixels = len(shot) * shot.intrinsics.height * shot.intrinsics.width

    def channel(wanted: bool, count: int, dtype: type) -> np.ndarray:
        return np.empty(pixels * count if wanted else 0, dtype)

    return Outputs(
        channel("rgb" in shot.want, 3, np.uint8),
        channel("depth" in shot.want, 1, np.float32),
        channel("normal" in shot.want, 3, np.float32),
        channel("face_id" in shot.want, 1, np.int32),
        channel(True, 1, np.bool_),
    )


def _as_pictures(out: Outputs, shot: Shot) -> Rendering:
    size = (len(shot), shot.intrinsics.height, shot.intrinsics.width)

    def shaped(name: str, values: np.ndarray, *tail: int) -> np.ndarray | None:
        return values.reshape(*size, *tail) if name in shot.want else None

    return Rendering(
        out.valid.reshape(size),
        shaped("rgb", out.rgb, 3),
        shaped("depth", out.depth),
        shaped("normal", out.normal, 3),
        shaped("face_id", out.face),
    )


def _scratch(camera: Camera, vertices: int) -> Scratch:
    """This thread's working memory, kept from call to call."""
    plane = -(-camera.height // BLOCK) * BLOCK * camera.stride
    kept: Scratch | None = getattr(_local, "scratch", None)
    if kept is None or kept.light.shape[1] != plane or kept.lit.shape[2] != vertices:
        rays, narrow = aligned(PACKET_FIELDS * LANES, np.float32), aligned(PACKET_FIELDS * LANES, np.float32)
        again, part = aligned(LANES, np.int32), aligned(LANES, np.int32)
        packet = Packet(rays, rays.view(np.int32), narrow, narrow.view(np.int32), again, part)
        kept = _local.scratch = Scratch(
            packet,
            np.zeros(6 * LANES, np.float32),
            np.zeros(LANES, np.int32),
            np.zeros((3, plane), np.float32),
            np.zeros((3, plane), np.float32),
            np.zeros(3 * LANES, np.uint8),
            np.zeros(METER_BINS, np.int64),
            np.zeros((2, 3, vertices), np.float32),
        )
    return kept


def aligned(count: int, dtype: type) -> np.ndarray:
    """Zeros that begin on a 64-byte boundary, as Embree demands of packets and masks."""
    raw = np.zeros(count * 4 + _ALIGNMENT, np.uint8)
    begin = -raw.ctypes.data % _ALIGNMENT
    return raw[begin : begin + count * 4].view(dtype)
