# ruff: noqa: ANN001, ANN201, ANN202
# mypy: ignore-errors
"""Rays in packets of sixteen: Embree's `rtcIntersect16` (or 8, or 4) called from compiled code by its address."""

from __future__ import annotations

from typing import NamedTuple, no_type_check

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from naris.render.lanes import LANES, choose, load, most, sqrt, store

PACKET_FIELDS = 24
"""Four-byte fields of an `RTCRayHit` packet (20, or 21 with instance arrays), rounded up."""
ORG_X, ORG_Y, ORG_Z, NEAR, DIR_X, DIR_Y, DIR_Z, TIME, FAR, MASK, ID, FLAGS = range(0, 12 * LANES, LANES)
NG_X, NG_Y, NG_Z, U, V, PRIM, GEOM, INST, INST_PRIM = range(12 * LANES, 21 * LANES, LANES)
_MOST_LAYERS = 64
_BEYOND = np.float32(1e-5)
"""How far behind a culled wall the ray goes on: this share of the way, and so many mm."""

_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False, _nrt=False, forceinline=True)
_apart_njit = njit(nogil=True, error_model="numpy", boundscheck=False, _nrt=False)


class Embree(NamedTuple):
    """Addresses of the function, the scene and its arguments, and how many rays the function takes."""

    function: int
    scene: int
    arguments: int
    width: int


class Packet(NamedTuple):
    """One packet, aligned to 64 bytes.

    Attributes:
        rays: (PACKET_FIELDS · 16,) float32, field after field.
        words: the same memory as int32.
        narrow: (PACKET_FIELDS · 8,) float32 for a function that takes fewer rays.
        narrow_words: the same memory as int32.
        again: (16,) int32, −1 for rays that go on behind a culled wall; aligned.
        part: (16,) int32, the valid mask of a part; aligned.
    """

    rays: np.ndarray
    words: np.ndarray
    narrow: np.ndarray
    narrow_words: np.ndarray
    again: np.ndarray
    part: np.ndarray


@intrinsic
@no_type_check
def _call(typing_context, function, valid, scene, packet, arguments):
    """rtcIntersectN(valid, scene, packet, arguments) at an address."""

    @no_type_check
    def generate(context, builder, signature, values):
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer] * 4).as_pointer()
        target = builder.inttoptr(values[0], kind)
        builder.call(target, [builder.inttoptr(value, pointer) for value in values[1:]])
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.intp, types.intp, types.intp), generate


@_njit
def begin_frame(packet, position):
    """Fills in what all rays of a frame share (Embree leaves it as it is)."""
    store(packet.rays, ORG_X, position[0])
    store(packet.rays, ORG_Y, position[1])
    store(packet.rays, ORG_Z, position[2])
    store(packet.rays, NEAR, np.float32(0))
    store(packet.rays, TIME, np.float32(0))
    store(packet.words, MASK, np.int32(-1))
    store(packet.words, FLAGS, np.int32(0))


@_njit
def intersect(embree, packet, valid, at, ray):
    """Sends a packet off; `valid[at : at + 16]` is −1 for rays that exist. What it met is left in the packet."""
    store(packet.rays, DIR_X, ray[0])
    store(packet.rays, DIR_Y, ray[1])
    store(packet.rays, DIR_Z, ray[2])
    store(packet.rays, FAR, np.float32(np.inf))
    store(packet.words, GEOM, np.int32(-1))
    store(packet.words, INST, np.int32(-1))
    if embree.width == LANES:
        _call(embree.function, valid.ctypes.data + 4 * at, embree.scene, packet.rays.ctypes.data, embree.arguments)
    else:
        _in_parts(embree, packet, valid, at)


@_njit
def found(packet, valid, at, ray):
    """Which lanes met a wall, the distance, face, u and v, and the wall's unit normal towards the camera.

    Then also the side: −1 where the wall is seen from inside the lumen, 1 from outside.
    """
    seen = (load(packet.words, GEOM) >= 0) & (load(valid, at) < 0)
    distance = choose(seen, load(packet.rays, FAR), 1.0)
    face = choose(seen, load(packet.words, PRIM), 0)
    x, y, z = load(packet.rays, NG_X), load(packet.rays, NG_Y), load(packet.rays, NG_Z)
    inverse = 1.0 / sqrt(most(x * x + y * y + z * z, np.float32(1e-30)))
    # A lane that met nothing still holds the normal that an earlier packet left there.
    side = choose(seen & (x * ray[0] + y * ray[1] + z * ray[2] > 0.0), -1.0, 1.0)
    scale = choose(seen, inverse * side, 0.0)
    u, v = choose(seen, load(packet.rays, U), 0.0), choose(seen, load(packet.rays, V), 0.0)
    return seen, distance, face, u, v, (x * scale, y * scale, z * scale), side


@_apart_njit
def _in_parts(embree, packet, valid, at):
    """One packet of sixteen as several of fewer rays."""
    width, mask = embree.width, packet.part
    for start in range(0, LANES, width):
        for field in range(PACKET_FIELDS):
            for k in range(width):
                packet.narrow_words[field * width + k] = packet.words[field * LANES + start + k]
        for k in range(width):
            mask[k] = valid[at + start + k]
        _call(embree.function, mask.ctypes.data, embree.scene, packet.narrow.ctypes.data, embree.arguments)
        for field in range(PACKET_FIELDS):
            for k in range(width):
                packet.words[field * LANES + start + k] = packet.narrow_words[field * width + k]


@_apart_njit
def look_through(embree, packet, valid, at, face_normals):
    """Sends rays on that met a wall from its inside, until each met one from outside, or none."""
    again = packet.again
    for layer in range(_MOST_LAYERS):
        pending = 0
        for k in range(LANES):
            again[k] = 0
            if valid[at + k] != 0 and packet.words[GEOM + k] >= 0:
                face, cosine = packet.words[PRIM + k], np.float32(0)
                for axis in range(3):
                    cosine += face_normals[face, axis] * packet.rays[DIR_X + LANES * axis + k]
                if cosine > 0:
                    pending += 1
                    again[k] = -1
                    packet.rays[NEAR + k] = packet.rays[FAR + k] * (np.float32(1) + _BEYOND) + _BEYOND
                    packet.rays[FAR + k] = np.float32(np.inf)
                    packet.words[GEOM + k] = -1
        if pending == 0 or layer == _MOST_LAYERS - 1:
            break
        if embree.width == LANES:
            _call(embree.function, again.ctypes.data, embree.scene, packet.rays.ctypes.data, embree.arguments)
        else:
            _in_parts(embree, packet, again, 0)
    for k in range(LANES):
        packet.rays[NEAR + k] = np.float32(0)
