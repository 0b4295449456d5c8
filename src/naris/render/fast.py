"""The fast engine: frames spread over threads, each rendered whole by the compiled kernel.

Every frame is worked off by one thread and depends on nothing but its own pose, appearance and seed, so that the
pictures are the same for any number of threads and any batch.
"""

from __future__ import annotations

import ctypes
import itertools
import logging
import threading
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float32, Int32

from naris.core.anatomy import Anatomy
from naris.core.camera import Intrinsics
from naris.render.embree import ARGUMENTS, PACKET_FIELDS, PacketScene, library
from naris.render.geometry import geometry_of
from naris.render.kernel import FIELDS, LANES, Camera, Embree, Outputs, Scratch, render_frames
from naris.render.look import pack
from naris.render.rays import ray_table
from naris.render.scene import Rendering, Shot
from naris.render.shading import METER_BINS

_BLOCK = 4
_ALIGNMENT = 64
_log = logging.getLogger(__name__)
_local = threading.local()


class FastEngine:
    """Embree packets shaded in compiled code.

    Raises:
        EngineUnavailable: if the library in `embreex` cannot be used.
    """

    name = "fast"

    def __init__(self, anatomy: Anatomy) -> None:
        self.geometry = geometry_of(anatomy)
        self._scene = PacketScene(self.geometry.vertices_mm, self.geometry.faces)
        found = library()
        self._embree = Embree(found.intersect, self._scene.address, ctypes.addressof(ARGUMENTS), found.width)

    def render(self, shot: Shot) -> Rendering:
        """All frames of a shot."""
        looks = pack(shot.appearances, len(self.geometry.vertices_mm))
        camera = _camera(shot.intrinsics)
        out = _outputs(shot)
        poses = (shot.rotation, shot.position_mm)
        seeds = (shot.seeds.astype(np.int64) & 0xFFFFFFFF).astype(np.uint64)

        def work(begin: int, end: int) -> None:
            scratch = _scratch(shot.intrinsics.height * shot.intrinsics.width, len(self.geometry.vertices_mm))
            render_frames(self._embree, camera, self.geometry, poses, looks, seeds, (begin, end), out, scratch)

        pieces = _pieces(len(shot), shot.threads)
        if len(pieces) <= 1:
            for piece in pieces:
                work(*piece)
        else:
            list(_pool(shot.threads).map(lambda piece: work(*piece), pieces))
        return _as_pictures(out, shot)


def _pieces(frames: int, threads: int) -> list[tuple[int, int]]:
    """Runs of frames, a few for each thread, so that an easy run does not leave its thread idle."""
    count = 1 if threads == 1 else min(frames, 4 * threads)
    edges = np.linspace(0, frames, count + 1).astype(int).tolist()
    return [(a, b) for a, b in itertools.pairwise(edges) if b > a]


@lru_cache(maxsize=4)
def _pool(threads: int) -> ThreadPoolExecutor:
    return ThreadPoolExecutor(threads, thread_name_prefix="naris-render")


@lru_cache(maxsize=16)
def _camera(intrinsics: Intrinsics) -> Camera:
    """The rays of a camera in blocks of 4×4 pixels, padded to whole packets."""
    rays = ray_table(intrinsics)
    height, width = intrinsics.height, intrinsics.width
    rows, columns = -(-height // _BLOCK) * _BLOCK, -(-width // _BLOCK) * _BLOCK
    index = np.full((rows, columns), -1, np.int32)
    index[:height, :width] = np.arange(height * width, dtype=np.int32).reshape(height, width)
    pixel = index.reshape(rows // _BLOCK, _BLOCK, columns // _BLOCK, _BLOCK).swapaxes(1, 2).ravel().copy()
    x, y, z = np.ascontiguousarray(rays.directions[np.maximum(pixel, 0)].T)
    valid = np.where((pixel >= 0) & rays.exists[np.maximum(pixel, 0)], -1, 0).astype(np.int32)
    return Camera(x, y, z, valid, pixel, np.float32(rays.pixel_rad), height, width)


def _outputs(shot: Shot) -> Outputs:
    n, pixels = len(shot), shot.intrinsics.height * shot.intrinsics.width

    def channel(wanted: bool, *tail: int, dtype: type) -> np.ndarray:
        return np.empty((n if wanted else 0, pixels, *tail), dtype)

    return Outputs(
        channel("rgb" in shot.want, 3, dtype=np.uint8),
        channel("depth" in shot.want, dtype=np.float32),
        channel("normal" in shot.want, 3, dtype=np.float32),
        channel("face_id" in shot.want, dtype=np.int32),
        channel(True, dtype=np.bool_),
    )


def _as_pictures(out: Outputs, shot: Shot) -> Rendering:
    size = (len(shot), shot.intrinsics.height, shot.intrinsics.width)

    def shaped(name: str, rows: np.ndarray) -> np.ndarray | None:
        return rows.reshape(*size, *rows.shape[2:]) if name in shot.want else None

    return Rendering(
        out.valid.reshape(size),
        shaped("rgb", out.rgb),
        shaped("depth", out.depth),
        shaped("normal", out.normal),
        shaped("face_id", out.face),
    )


def _scratch(pixels: int, vertices: int) -> Scratch:
    """This thread's working memory, kept from call to call."""
    kept: Scratch | None = getattr(_local, "scratch", None)
    if kept is None or len(kept.light) != pixels or kept.lit.shape[1] != vertices:
        kept = _local.scratch = Scratch(
            _aligned(PACKET_FIELDS * 16, np.float32),
            _aligned(16, np.int32),
            np.zeros((FIELDS, LANES), np.float32),
            np.zeros(LANES, np.int32),
            np.zeros((pixels, 3), np.float32),
            np.zeros((pixels, 3), np.float32),
            np.zeros(METER_BINS, np.int64),
            np.zeros((2, vertices, 3), np.float32),
        )
    return kept


def _aligned(count: int, dtype: type) -> np.ndarray:
    """Zeros that begin on a 64-byte boundary, as Embree demands of packets."""
    raw = np.zeros(count * 4 + _ALIGNMENT, np.uint8)
    begin = -raw.ctypes.data % _ALIGNMENT
    return raw[begin : begin + count * 4].view(dtype)


__all__ = ["Bool", "FastEngine", "Float32", "Int32"]
