# ruff: noqa: ANN001, ANN202
# mypy: ignore-errors
"""The fast engine's compiled code: Embree packets and the shading of `naris.render.shading`, fused.

A packet is a block of 4×4 pixels; its numbers stay in the processor's registers from the ray to the light that comes
back. Then the whole frame is developed. The formulas are those of `shading`: read them there.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from naris.render.develop import develop, expose
from naris.render.lanes import (
    LANES,
    choose,
    load,
    store,
    store_block,
    store_block_of_masks,
    store_block_of_triples,
)
from naris.render.look import LIT_VERTICES, MUCOSA, UNIFORM
from naris.render.packets import Packet, begin_frame, found, intersect, look_through
from naris.render.wall import (
    interpolated_colour,
    interpolated_normal,
    lamp_of,
    light_back,
    light_vertices,
    mucosa,
)

BLOCK = 4


class Camera(NamedTuple):
    """Rays in blocks of 4×4 pixels, 16 numbers a block, blocks in rows.

    Attributes:
        x, y, z: direction in the camera.
        valid: −1 where there is a ray, else 0; aligned to 64 bytes.
        column, row: of the pixel inside its block, (16,) each.
        pixel_rad: angle between neighbouring pixels.
        height, width: of the picture.
        stride: from row to row of the planes in `Scratch`.
    """

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    valid: np.ndarray
    column: np.ndarray
    row: np.ndarray
    pixel_rad: np.float32
    height: int
    width: int
    stride: int


class Surface(NamedTuple):
    """A surface as the kernel reads it.

    Attributes:
        faces: (F, 3) int32.
        face_normals: (F, 3) outward.
        corner_normals: (F, 9) vertex normals of the three corners.
        vertices: (6, V16) x, y, z and the normal, padded to a multiple of 16.
        colours: (T, 3, V16) vertex colours.
    """

    faces: np.ndarray
    face_normals: np.ndarray
    corner_normals: np.ndarray
    vertices: np.ndarray
    colours: np.ndarray


class Tables(NamedTuple):
    """`naris.render.look.Looks`, flat: rows, ramp (N, 3, RAMP_SIZE), tone, spot, and the noise as 32-bit words."""

    rows: np.ndarray
    ramp: np.ndarray
    tone: np.ndarray
    spot: np.ndarray
    bank: np.ndarray


class Outputs(NamedTuple):
    """Channels of all frames, flat; an array of no elements where a channel is not wanted."""

    rgb: np.ndarray
    depth: np.ndarray
    normal: np.ndarray
    face: np.ndarray
    valid: np.ndarray


class Scratch(NamedTuple):
    """What one thread needs.

    Attributes:
        packet: the rays in flight.
        spill, bins: (96,) and (16,) lanes as arrays.
        light: (3, rows · stride) light of the frame, −1 outside the round stop.
        grey: the same, developed.
        run: (48,) bytes at the end of a row.
        counts: the light meter.
        lit: (2, 3, V16) lit vertices, seen from outside and from inside.
    """

    packet: Packet
    spill: np.ndarray
    bins: np.ndarray
    light: np.ndarray
    grey: np.ndarray
    run: np.ndarray
    counts: np.ndarray
    lit: np.ndarray


_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False, _nrt=False, forceinline=True)
_cached_njit = njit(cache=True, nogil=True, fastmath=True, error_model="numpy", boundscheck=False, _nrt=False)


@_cached_njit
def render_frames(embree, camera, surface, poses, looks, seeds, frames, out, scratch, sources) -> None:  # noqa: PLR0913
    """Renders frames[0] … frames[1] − 1 into `out`; all but `scratch` may be shared between threads.

    `sources` only has a type that changes with the sources of the kernel, so that no stale code is taken from disk.
    """
    for i in range(frames[0], frames[1]):
        row, rotation, position = looks.rows[i], poses[0][i], poses[1][i]
        lamp = lamp_of(row, rotation)
        scratch.counts[:] = 0
        if len(out.rgb) and row.kind == LIT_VERTICES:
            light_vertices(surface, looks.spot, i, row, position, lamp, scratch.lit)
        begin_frame(scratch.packet, position)
        _frame(embree, camera, surface, (i, rotation, position, lamp), looks, out, scratch)
        if len(out.rgb):
            develop(camera, row, looks.tone, seeds[i], i, out.rgb, scratch)


@_njit
def _frame(embree, camera, surface, view, looks, out, scratch):
    """Rays of all blocks, and the light that comes back."""
    i, rotation, position, lamp = view
    row, across = looks.rows[i], (camera.width + BLOCK - 1) // BLOCK
    for block in range(across * ((camera.height + BLOCK - 1) // BLOCK)):
        top, left, at = block // across * BLOCK, block % across * BLOCK, block * LANES
        ray = _turn(camera, rotation, at)
        intersect(embree, scratch.packet, camera.valid, at, ray)
        if row.cull:
            look_through(embree, scratch.packet, camera.valid, at, surface.face_normals)
        seen, distance, face, u, v, flat, side = found(scratch.packet, camera.valid, at, ray)
        depth = distance * load(camera.z, at)
        _channels(camera, rotation, (i, top, left), (seen, face, depth, flat), out, scratch)
        if len(out.rgb):
            if row.kind == LIT_VERTICES:
                inside = choose(side < 0.0, 3 * surface.vertices.shape[1], 0)
                light = interpolated_colour(surface, scratch.lit, inside, face, u, v)
            else:
                normal = interpolated_normal(surface, face, u, v, side)
                zero = distance * 0.0
                albedo = (zero + row.albedo_r, zero + row.albedo_g, zero + row.albedo_b)
                if row.kind == MUCOSA:
                    point = (
                        position[0] + distance * ray[0],
                        position[1] + distance * ray[1],
                        position[2] + distance * ray[2],
                    )
                    pixel_mm = distance * camera.pixel_rad
                    albedo, normal = mucosa(looks.bank, looks.ramp, i, row, point, pixel_mm, normal)
                elif row.kind != UNIFORM:
                    begin = 3 * row.colours * surface.vertices.shape[1]
                    albedo = interpolated_colour(surface, surface.colours, begin, face, u, v)
                way = (distance, ray[0], ray[1], ray[2])
                light = light_back(looks.spot, i, row, lamp, way, normal, albedo)
            expose(camera, row, (top, left), seen, light, scratch)


@_njit
def _turn(camera, r, at):
    """Ray directions in the anatomy."""
    x, y, z = load(camera.x, at), load(camera.y, at), load(camera.z, at)
    return (
        r[0, 0] * x + r[0, 1] * y + r[0, 2] * z,
        r[1, 0] * x + r[1, 1] * y + r[1, 2] * z,
        r[2, 0] * x + r[2, 1] * y + r[2, 2] * z,
    )


@_njit
def _channels(camera, r, place, hit, out, scratch):
    """Writes what is known without light."""
    i, top, left = place
    seen, face, depth, (x, y, z) = hit
    at = (i * camera.height + top) * camera.width + left
    face, depth = choose(seen, face, -1), choose(seen, depth, 0.0)
    nx = r[0, 0] * x + r[1, 0] * y + r[2, 0] * z
    ny = r[0, 1] * x + r[1, 1] * y + r[2, 1] * z
    nz = r[0, 2] * x + r[1, 2] * y + r[2, 2] * z
    if top + BLOCK <= camera.height and left + BLOCK <= camera.width:
        store_block_of_masks(out.valid, at, camera.width, seen)
        if len(out.face):
            store_block(out.face, at, camera.width, face)
        if len(out.depth):
            store_block(out.depth, at, camera.width, depth)
        if len(out.normal):
            store_block_of_triples(out.normal, 3 * at, 3 * camera.width, nx, ny, nz)
    else:
        store(scratch.bins, 0, face)
        for k, lanes in enumerate((depth, nx, ny, nz)):
            store(scratch.spill, LANES * k, lanes)
        _part_of_block(camera, at, top, left, out, scratch)


@_njit
def _part_of_block(camera, at, top, left, out, scratch):
    """The pixels of a block that lie in the picture."""
    for lane in range(LANES):
        down, right = lane // BLOCK, lane % BLOCK
        if top + down < camera.height and left + right < camera.width:
            p, face = at + down * camera.width + right, scratch.bins[lane]
            out.valid[p] = face >= 0
            if len(out.face):
                out.face[p] = face
            if len(out.depth):
                out.depth[p] = scratch.spill[lane]
            if len(out.normal):
                for axis in range(3):
                    out.normal[3 * p + axis] = scratch.spill[LANES * (1 + axis) + lane]
