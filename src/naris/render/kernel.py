"""The fast engine's compiled code: Embree packets and the shading of `naris.render.shading`, fused frame by frame.

A frame is worked off in chunks of `LANES` pixels (4×4 blocks side by side), whose numbers fit the first-level cache:
trace, geometry channels, wall, light; then the whole frame is developed. The formulas are those of `shading`; read
them there. Constants are single precision throughout, since one double would double the work.
"""

# ruff: noqa: ANN001, ANN202
# mypy: allow-untyped-defs, allow-untyped-calls, allow-untyped-decorators
from __future__ import annotations

import math
from typing import NamedTuple, no_type_check

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic

from naris.render.look import (
    LIT_VERTICES,
    MUCOSA,
    RAMP_BLOOD,
    RAMP_SIZE,
    SPOT_SIZE,
    TONE_REACH,
    TONE_SIZE,
    UNIFORM,
    VERTEX_COLOURS,
)
from naris.render.noise import BYTE_SUM_STD, EDGE
from naris.render.shading import LUMINANCE, METER_BINS, METER_BINS_PER_OCTAVE, METER_FIRST_OCTAVE, SHALLOWEST_COSINE

LANES = 256
"""Pixels in a chunk."""
MOST_LAYERS = 64
_F = np.float32
_ZERO, _ONE, _HALF, _TWO = _F(0), _F(1), _F(0.5), _F(2)
_INFINITY = _F(np.inf)


class Camera(NamedTuple):
    """Rays in blocks of 4×4 pixels, padded to whole packets."""

    x: np.ndarray
    y: np.ndarray
    z: np.ndarray
    valid: np.ndarray
    pixel: np.ndarray
    pixel_rad: np.float32
    height: int
    width: int


class Embree(NamedTuple):
    """Addresses of the function, the scene and its arguments, and the rays in a packet."""

    function: int
    scene: int
    arguments: int
    width: int


class Outputs(NamedTuple):
    """Channels of all frames, pixels in rows; an array of no frames where a channel is not wanted."""

    rgb: np.ndarray
    depth: np.ndarray
    normal: np.ndarray
    face: np.ndarray
    valid: np.ndarray


class Scratch(NamedTuple):
    """What one thread needs: a packet, the fields of a chunk, and a frame of light."""

    packet: np.ndarray
    mask: np.ndarray
    fields: np.ndarray
    face: np.ndarray
    light: np.ndarray
    grey: np.ndarray
    counts: np.ndarray
    lit: np.ndarray


@intrinsic
@no_type_check
def _intersect(typing_context, function, valid, scene, packet, arguments):
    """Calls rtcIntersectN(valid, scene, packet, arguments) at an address."""

    def generate(context, builder, signature, values):
        pointer = ir.IntType(8).as_pointer()
        kind = ir.FunctionType(ir.VoidType(), [pointer] * 4).as_pointer()
        target = builder.inttoptr(values[0], kind)
        builder.call(target, [builder.inttoptr(value, pointer) for value in values[1:]])
        return context.get_dummy_value()

    return types.void(types.intp, types.intp, types.intp, types.intp, types.intp), generate


@intrinsic
@no_type_check
def _bits(typing_context, value):
    """The bits of a single as an int32."""

    def generate(context, builder, signature, values):
        return builder.bitcast(values[0], ir.IntType(32))

    return types.int32(types.float32), generate


_fast_njit = njit(cache=True, nogil=True, fastmath=True, error_model="numpy", boundscheck=False)

# Rows of `Scratch.fields`, one number a pixel of the chunk.
DX, DY, DZ, T, U, V, SIDE, NX, NY, NZ, R, G, B, LX, LY, LZ = range(16)
FIELDS = 16
# Fields of an RTCRayHit packet.
_ORG_X, _ORG_Y, _ORG_Z, _NEAR, _DIR_X, _DIR_Y, _DIR_Z, _TIME, _FAR, _MASK, _ID, _FLAGS = range(12)
_NG_X, _NG_Y, _NG_Z, _U, _V, _PRIM, _GEOM, _INST, _INST_PRIM = range(12, 21)


@_fast_njit
def render_frames(embree, camera, geometry, poses, looks, seeds, frames, out, scratch) -> None:  # noqa: PLR0913
    """Renders frames[0] … frames[1] − 1 into `out`; all but `scratch` may be shared between threads."""
    for i in range(frames[0], frames[1]):
        row = looks.rows[i]
        rotation, position = poses[0][i], poses[1][i]
        scratch.counts[:] = 0
        if len(out.rgb) and row.kind == LIT_VERTICES:
            _light_vertices(geometry, looks, row, rotation, position, scratch.lit)
        for begin in range(0, len(camera.x), LANES):
            lanes = min(LANES, len(camera.x) - begin)
            _trace(embree, camera, geometry, rotation, position, (begin, lanes, row.cull), scratch)
            _geometry_channels(camera, geometry, rotation, (i, begin, lanes), out, scratch)
            if len(out.rgb):
                _normals(geometry, lanes, scratch)
                if row.kind == MUCOSA:
                    _mucosa(camera, looks.bank[row.bank], looks.ramp[i], (row, position, lanes), scratch)
                else:
                    _plain_wall(geometry, looks, row, lanes, scratch)
                if row.kind != LIT_VERTICES:
                    _light(looks.spot[i], row, rotation, lanes, scratch)
                _expose(camera, row, (begin, lanes), scratch)
        if len(out.rgb):
            _develop(camera, row, looks.tone[i], seeds[i], out.rgb[i], scratch)


@_fast_njit
def _trace(embree, camera, geometry, rotation, position, chunk, scratch):
    """Directions (anatomy), distance, u, v and face of a chunk; face −1 where nothing is met."""
    begin, lanes, cull = chunk
    width, fields = embree.width, scratch.fields
    packet, integers = scratch.packet, scratch.packet.view(np.int32)
    address, mask_address = packet.ctypes.data, scratch.mask.ctypes.data
    r00, r01, r02 = rotation[0, 0], rotation[0, 1], rotation[0, 2]
    r10, r11, r12 = rotation[1, 0], rotation[1, 1], rotation[1, 2]
    r20, r21, r22 = rotation[2, 0], rotation[2, 1], rotation[2, 2]
    dx, dy, dz = fields[DX], fields[DY], fields[DZ]
    for k in range(lanes):
        x, y, z = camera.x[begin + k], camera.y[begin + k], camera.z[begin + k]
        dx[k] = r00 * x + r01 * y + r02 * z
        dy[k] = r10 * x + r11 * y + r12 * z
        dz[k] = r20 * x + r21 * y + r22 * z
    for start in range(0, lanes, width):
        for k in range(width):
            packet[_ORG_X * width + k] = position[0]
            packet[_ORG_Y * width + k] = position[1]
            packet[_ORG_Z * width + k] = position[2]
            packet[_NEAR * width + k] = _ZERO
            packet[_DIR_X * width + k] = dx[start + k]
            packet[_DIR_Y * width + k] = dy[start + k]
            packet[_DIR_Z * width + k] = dz[start + k]
            packet[_TIME * width + k] = _ZERO
            packet[_FAR * width + k] = _INFINITY
            integers[_MASK * width + k] = -1
            integers[_FLAGS * width + k] = 0
            integers[_GEOM * width + k] = -1
            integers[_INST * width + k] = -1
            scratch.mask[k] = camera.valid[begin + start + k]
        _intersect(embree.function, mask_address, embree.scene, address, embree.arguments)
        if cull:
            _look_through(embree, geometry, packet, integers, scratch.mask)
        for k in range(width):
            seen = scratch.mask[k] != 0 and integers[_GEOM * width + k] >= 0
            scratch.face[start + k] = integers[_PRIM * width + k] if seen else -1
            fields[T, start + k] = packet[_FAR * width + k] if seen else _ONE
            fields[U, start + k] = packet[_U * width + k] if seen else _ZERO
            fields[V, start + k] = packet[_V * width + k] if seen else _ZERO


@_fast_njit
def _look_through(embree, geometry, packet, integers, mask):
    """Sends rays on that met a wall from its inside, until all met one from outside, or none."""
    width = embree.width
    again = np.empty(16, np.int32)
    for _ in range(MOST_LAYERS):
        pending = False
        for k in range(width):
            again[k] = 0
            if mask[k] != 0 and integers[_GEOM * width + k] >= 0:
                face = integers[_PRIM * width + k]
                cosine = _ZERO
                for axis in range(3):
                    cosine += geometry.face_normals[face, axis] * packet[(_DIR_X + axis) * width + k]
                if cosine > _ZERO:
                    again[k], pending = -1, True
                    packet[_NEAR * width + k] = packet[_FAR * width + k] * _F(1 + 1e-5) + _F(1e-5)
                    packet[_FAR * width + k] = _INFINITY
                    integers[_GEOM * width + k] = -1
        if not pending:
            return
        _intersect(embree.function, again.ctypes.data, embree.scene, packet.ctypes.data, embree.arguments)
    for k in range(width):
        if again[k] != 0:
            integers[_GEOM * width + k] = -1


@_fast_njit
def _geometry_channels(camera, geometry, rotation, chunk, out, scratch):
    """Depth, normal, face and validity of a chunk; which side of each wall is seen."""
    i, begin, lanes = chunk
    fields = scratch.fields
    for k in range(lanes):
        pixel, face = camera.pixel[begin + k], scratch.face[k]
        seen = face >= 0
        at = np.uint32(max(face, 0))
        x, y, z = geometry.face_normals[at, 0], geometry.face_normals[at, 1], geometry.face_normals[at, 2]
        side = -_ONE if x * fields[DX, k] + y * fields[DY, k] + z * fields[DZ, k] > _ZERO else _ONE
        fields[SIDE, k] = side
        if pixel < 0:
            continue
        p = np.uint32(pixel)
        out.valid[i, p] = seen
        if len(out.face):
            out.face[i, p] = face
        if len(out.depth):
            out.depth[i, p] = fields[T, k] * camera.z[begin + k] if seen else _ZERO
        if len(out.normal):
            keep = side if seen else _ZERO
            x, y, z = x * keep, y * keep, z * keep
            out.normal[i, p, 0] = rotation[0, 0] * x + rotation[1, 0] * y + rotation[2, 0] * z
            out.normal[i, p, 1] = rotation[0, 1] * x + rotation[1, 1] * y + rotation[2, 1] * z
            out.normal[i, p, 2] = rotation[0, 2] * x + rotation[1, 2] * y + rotation[2, 2] * z


@_fast_njit
def _normals(geometry, lanes, scratch):
    """Interpolated unit normals on the side that is seen."""
    fields = scratch.fields
    for k in range(lanes):
        face = np.uint32(max(scratch.face[k], 0))
        a, b, c = (
            np.uint32(geometry.faces[face, 0]),
            np.uint32(geometry.faces[face, 1]),
            np.uint32(geometry.faces[face, 2]),
        )
        u, v = fields[U, k], fields[V, k]
        w = _ONE - u - v
        n = geometry.vertex_normals
        x = w * n[a, 0] + u * n[b, 0] + v * n[c, 0]
        y = w * n[a, 1] + u * n[b, 1] + v * n[c, 1]
        z = w * n[a, 2] + u * n[b, 2] + v * n[c, 2]
        scale = fields[SIDE, k] / math.sqrt(max(x * x + y * y + z * z, _F(1e-24)))
        fields[NX, k], fields[NY, k], fields[NZ, k] = x * scale, y * scale, z * scale


@_fast_njit
def _plain_wall(geometry, looks, row, lanes, scratch):
    """The wall's own colour, or its colour as lit at the vertices."""
    fields = scratch.fields
    if row.kind == UNIFORM:
        for k in range(lanes):
            fields[R, k], fields[G, k], fields[B, k] = row.albedo_r, row.albedo_g, row.albedo_b
        return
    colours = looks.colours[max(row.colours, 0)]
    for k in range(lanes):
        face = np.uint32(max(scratch.face[k], 0))
        a, b, c = (
            np.uint32(geometry.faces[face, 0]),
            np.uint32(geometry.faces[face, 1]),
            np.uint32(geometry.faces[face, 2]),
        )
        u, v = fields[U, k], fields[V, k]
        w = _ONE - u - v
        side = colours if row.kind == VERTEX_COLOURS else scratch.lit[1 if fields[SIDE, k] < _ZERO else 0]
        fields[R, k] = w * side[a, 0] + u * side[b, 0] + v * side[c, 0]
        fields[G, k] = w * side[a, 1] + u * side[b, 1] + v * side[c, 1]
        fields[B, k] = w * side[a, 2] + u * side[b, 2] + v * side[c, 2]


@_fast_njit
def _trilinear(volume, x, y, z):
    """Four fields of a periodic volume at a point in voxels, positive."""
    x0, y0, z0 = np.uint32(x), np.uint32(y), np.uint32(z)
    tx, ty, tz = x - _F(x0), y - _F(y0), z - _F(z0)
    wrap = np.uint32(EDGE - 1)
    x1, y1, z1 = (x0 + np.uint32(1)) & wrap, (y0 + np.uint32(1)) & wrap, (z0 + np.uint32(1)) & wrap
    x0, y0, z0 = x0 & wrap, y0 & wrap, z0 & wrap
    a, b, c, d = volume[x0, y0], volume[x0, y1], volume[x1, y0], volume[x1, y1]
    sx, sy, sz = _ONE - tx, _ONE - ty, _ONE - tz
    wa, wb, wc, wd = sx * sy, sx * ty, tx * sy, tx * ty
    p = sz * (wa * a[z0, 0] + wb * b[z0, 0] + wc * c[z0, 0] + wd * d[z0, 0])
    q = sz * (wa * a[z0, 1] + wb * b[z0, 1] + wc * c[z0, 1] + wd * d[z0, 1])
    r = sz * (wa * a[z0, 2] + wb * b[z0, 2] + wc * c[z0, 2] + wd * d[z0, 2])
    s = sz * (wa * a[z0, 3] + wb * b[z0, 3] + wc * c[z0, 3] + wd * d[z0, 3])
    p += tz * (wa * a[z1, 0] + wb * b[z1, 0] + wc * c[z1, 0] + wd * d[z1, 0])
    q += tz * (wa * a[z1, 1] + wb * b[z1, 1] + wc * c[z1, 1] + wd * d[z1, 1])
    r += tz * (wa * a[z1, 2] + wb * b[z1, 2] + wc * c[z1, 2] + wd * d[z1, 2])
    s += tz * (wa * a[z1, 3] + wb * b[z1, 3] + wc * c[z1, 3] + wd * d[z1, 3])
    return p, q, r, s


@_fast_njit
def _clip(value, low, high):
    return min(max(value, low), high)


@_fast_njit
def _line(field, width, coarse):
    """1 on the zero line of a field, 0 beyond a width; wider and weaker where a pixel spans `coarse` voxels."""
    blur = _F(0.3) * coarse
    seen = math.sqrt(width * width + blur * blur)
    t = max(_ONE - abs(field) / seen, _ZERO)
    return t * t * (_F(3) - _TWO * t) * (width / seen)


@_fast_njit
def _mucosa(camera, bank, ramp, frame, scratch):
    """Albedo of a mucosa, and the normal turned by its relief."""
    row, position, lanes = frame
    fields, tissue, relief = scratch.fields, bank[0], bank[1]
    tissue_per_mm, relief_per_mm, depth = row.tissue_per_mm, row.relief_per_mm, row.relief
    ramp_scale = _F((RAMP_SIZE - 1) / RAMP_BLOOD)
    for k in range(lanes):
        t = fields[T, k]
        px, py, pz = position[0] + t * fields[DX, k], position[1] + t * fields[DY, k], position[2] + t * fields[DZ, k]
        x = row.m00 * px + row.m01 * py + row.m02 * pz
        y = row.m10 * px + row.m11 * py + row.m12 * pz
        z = row.m20 * px + row.m21 * py + row.m22 * pz
        pixel_mm = t * camera.pixel_rad
        coarse, spread = pixel_mm * relief_per_mm, pixel_mm * tissue_per_mm
        fade = _ONE / (_ONE + coarse * coarse * _F(1 / 16))
        fine, gx, gy, gz = _trilinear(
            relief, x * relief_per_mm + row.relief_x, y * relief_per_mm + row.relief_y, z * relief_per_mm + row.relief_z
        )
        gx, gy, gz = gx * fade, gy * fade, gz * fade
        blotch, change, large, small = _trilinear(
            tissue,
            x * tissue_per_mm + row.tissue_x + gx,
            y * tissue_per_mm + row.tissue_y + gy,
            z * tissue_per_mm + row.tissue_z + gz,
        )
        width = row.vessel_width * _clip(_HALF + _HALF * change, _F(0.05), _F(1.5))
        blood = row.blood + row.blotches * blotch
        blood += row.vessels * (_line(large, width, spread) + _F(0.6) * _line(small, _F(0.6) * width, spread))
        narrow = row.vessel_width * _clip(_F(0.6) - _F(0.6) * change, _F(0.05), _F(1.5))
        blood += row.fine_vessels * _line(fine, narrow, coarse)
        at = _clip(blood * ramp_scale, _ZERO, _F(RAMP_SIZE - 1.001))
        low = np.uint32(at)
        rest = at - _F(low)
        cover = row.mucus * _clip(_HALF - _HALF * blotch + _HALF * change, _ZERO, _ONE)
        up = low + np.uint32(1)
        r = ramp[low, 0] + rest * (ramp[up, 0] - ramp[low, 0])
        g = ramp[low, 1] + rest * (ramp[up, 1] - ramp[low, 1])
        b = ramp[low, 2] + rest * (ramp[up, 2] - ramp[low, 2])
        fields[R, k] = r + cover * (row.mucus_r - r)
        fields[G, k] = g + cover * (row.mucus_g - g)
        fields[B, k] = b + cover * (row.mucus_b - b)
        sx = row.m00 * gx + row.m10 * gy + row.m20 * gz
        sy = row.m01 * gx + row.m11 * gy + row.m21 * gz
        sz = row.m02 * gx + row.m12 * gy + row.m22 * gz
        nx, ny, nz = fields[NX, k], fields[NY, k], fields[NZ, k]
        along = sx * nx + sy * ny + sz * nz
        nx, ny, nz = nx - depth * (sx - along * nx), ny - depth * (sy - along * ny), nz - depth * (sz - along * nz)
        scale = _ONE / math.sqrt(max(nx * nx + ny * ny + nz * nz, _F(1e-24)))
        fields[NX, k], fields[NY, k], fields[NZ, k] = nx * scale, ny * scale, nz * scale


@_fast_njit
def _light(spot, row, rotation, lanes, scratch):
    """Turns albedo into the light that comes to the camera."""
    fields = scratch.fields
    ox = rotation[0, 0] * row.light_x + rotation[0, 1] * row.light_y + rotation[0, 2] * row.light_z
    oy = rotation[1, 0] * row.light_x + rotation[1, 1] * row.light_y + rotation[1, 2] * row.light_z
    oz = rotation[2, 0] * row.light_x + rotation[2, 1] * row.light_y + rotation[2, 2] * row.light_z
    axis_x, axis_y, axis_z = rotation[0, 2], rotation[1, 2], rotation[2, 2]
    constant, linear, quadratic, bounce = row.constant, row.linear, row.quadratic, row.bounce
    wrap_r, wrap_g, wrap_b = row.wrap_r, row.wrap_g, row.wrap_b
    scale_r, scale_g, scale_b = _ONE / (_ONE + wrap_r), _ONE / (_ONE + wrap_g), _ONE / (_ONE + wrap_b)
    gloss, film, sheen, tissue = row.gloss, row.film, row.sheen, row.tissue
    shiny = row.kind == MUCOSA
    for k in range(lanes):
        t, dx, dy, dz = fields[T, k], fields[DX, k], fields[DY, k], fields[DZ, k]
        nx, ny, nz = fields[NX, k], fields[NY, k], fields[NZ, k]
        lx, ly, lz = ox - t * dx, oy - t * dy, oz - t * dz
        r = math.sqrt(lx * lx + ly * ly + lz * lz)
        inverse = _ONE / r
        lx, ly, lz = lx * inverse, ly * inverse, lz * inverse
        cosine = _clip(nx * lx + ny * ly + nz * lz, _F(SHALLOWEST_COSINE), _ONE)
        angle = (_ONE + lx * axis_x + ly * axis_y + lz * axis_z) * _F((SPOT_SIZE - 1) / 2)
        at = _clip(angle, _ZERO, _F(SPOT_SIZE - 1.001))
        low = np.uint32(at)
        strength = spot[low] + (at - _F(low)) * (spot[low + np.uint32(1)] - spot[low])
        fall = strength / (constant + r * (linear + r * quadratic))
        red = row.spot_ambient_r + row.light_r * ((cosine + wrap_r) * scale_r + bounce)
        green = row.spot_ambient_g + row.light_g * ((cosine + wrap_g) * scale_g + bounce)
        blue = row.spot_ambient_b + row.light_b * ((cosine + wrap_b) * scale_b + bounce)
        shine = _ZERO
        if shiny:
            hx, hy, hz = lx - dx, ly - dy, lz - dz
            facing = max(nx * hx + ny * hy + nz * hz, _ZERO)
            facing = min(facing * facing / max(hx * hx + hy * hy + hz * hz, _F(1e-12)), _ONE)
            wet, dull = film / (_ONE - facing * (_ONE - film)), tissue / (_ONE - facing * (_ONE - tissue))
            shine = fall * (gloss * wet * wet + sheen * dull * dull)
        fields[R, k] = fields[R, k] * (row.ambient_r + fall * red) + shine * row.light_r
        fields[G, k] = fields[G, k] * (row.ambient_g + fall * green) + shine * row.light_g
        fields[B, k] = fields[B, k] * (row.ambient_b + fall * blue) + shine * row.light_b


@_fast_njit
def _expose(camera, row, chunk, scratch):
    """Puts the light of a chunk behind the optics into the frame; −1 where the stop is. Meters it."""
    begin, lanes = chunk
    fields, counts = scratch.fields, scratch.counts
    half = _F(camera.height) * _HALF
    centre_x, centre_y = _F(camera.width - 1) * _HALF, _F(camera.height - 1) * _HALF
    aspect = _F(camera.width) / _F(camera.height)
    vignette = row.vignette / (_ONE + aspect * aspect)
    plain = row.vignette == _ZERO and row.mask_radius < _ZERO
    base = (127 + METER_FIRST_OCTAVE) * METER_BINS_PER_OCTAVE
    for k in range(lanes):
        pixel = camera.pixel[begin + k]
        if pixel < 0:
            continue
        weight = _ONE
        if not plain:
            line = pixel // camera.width
            x, y = (_F(pixel - line * camera.width) - centre_x) / half, (_F(line) - centre_y) / half
            weight = max(_ONE - vignette * (x * x + y * y), _ZERO)
            if row.mask_radius >= _ZERO:
                x, y = x - row.mask_x, y - row.mask_y
                weight *= _clip((row.mask_radius - math.sqrt(x * x + y * y)) / row.mask_softness, _ZERO, _ONE)
        p = np.uint32(pixel)
        if weight <= _ZERO:
            scratch.light[p, 0] = scratch.light[p, 1] = scratch.light[p, 2] = -_ONE
            continue
        if scratch.face[k] < 0:
            weight = _ZERO
        r, g, b = fields[R, k] * weight, fields[G, k] * weight, fields[B, k] * weight
        scratch.light[p, 0], scratch.light[p, 1], scratch.light[p, 2] = r, g, b
        luminance = _F(LUMINANCE[0]) * r + _F(LUMINANCE[1]) * g + _F(LUMINANCE[2]) * b
        at = (_bits(luminance) >> 18) - base
        counts[min(max(at, 0), METER_BINS - 1)] += 1


@_fast_njit
def _metered(counts, quantile):
    """As `shading.quantile_of_histogram`."""
    total = 0
    for k in range(METER_BINS):
        total += counts[k]
    wanted, below = quantile * total, 0
    for k in range(METER_BINS):
        if below + counts[k] >= wanted:
            if k == 0:
                return 0.0
            octave, step = k // METER_BINS_PER_OCTAVE, k % METER_BINS_PER_OCTAVE
            share = (wanted - below) / max(counts[k], 1)
            return 2.0 ** (METER_FIRST_OCTAVE + octave) * (1 + (step + share) / METER_BINS_PER_OCTAVE)
        below += counts[k]
    return 0.0


@_fast_njit
def _noise(seed, index):
    """As `shading.white_noise`."""
    low = np.uint64(0xFFFFFFFF)
    x = (np.uint64(index) * np.uint64(0x9E3779B1) + seed) & low
    x ^= x >> np.uint64(16)
    x = (x * np.uint64(0x7FEB352D)) & low
    x ^= x >> np.uint64(15)
    x = (x * np.uint64(0x846CA68B)) & low
    x ^= x >> np.uint64(16)
    byte = np.uint64(255)
    total = (x & byte) + ((x >> np.uint64(8)) & byte) + ((x >> np.uint64(16)) & byte) + (x >> np.uint64(24))
    return (_F(np.int32(total)) - _F(510)) * _F(1 / BYTE_SUM_STD)


@_fast_njit
def _develop(camera, row, tone, seed, out, scratch):
    """Grey levels of the frame: exposure, tone curve, noise, filter."""
    gain = row.gain
    if row.auto > _ZERO:
        level = _F(_metered(scratch.counts, float(row.quantile)))
        automatic = _clip(row.target / max(level, _F(1e-9)), row.gain_low, row.gain_high)
        gain = gain * automatic**row.auto
    light, grey = scratch.light, scratch.grey
    gains = (gain * row.balance_r, gain * row.balance_g, gain * row.balance_b)
    scale, reach = _F((TONE_SIZE - 1) / TONE_REACH), _F(TONE_SIZE - 1.001)
    noisy, read, shot = row.read_noise > _ZERO or row.shot_noise > _ZERO, row.read_noise, row.shot_noise
    filtered = row.tap0 != _ONE
    for p in range(len(light)):
        for c in range(3):
            at = min(math.sqrt(max(light[p, c], _ZERO) * gains[c]) * scale, reach)
            low = np.uint32(at)
            value = tone[low] + (at - _F(low)) * (tone[low + np.uint32(1)] - tone[low])
            if noisy and light[p, c] >= _ZERO:
                value += _noise(seed, 3 * p + c) * (read + shot * math.sqrt(value * _F(1 / 255)))
            if filtered:
                grey[p, c] = value
            else:
                out[p, c] = np.uint8(_clip(value + _HALF, _ZERO, _F(255)))
    if filtered:
        _filter(camera, row, scratch, out)


@_fast_njit
def _light_vertices(geometry, looks, row, rotation, position, lit):
    """As `shading.light_vertices`."""
    if row.colours < 0:
        colours, many = np.empty((1, 3), np.float32), False
        colours[0, 0], colours[0, 1], colours[0, 2] = row.albedo_r, row.albedo_g, row.albedo_b
    else:
        colours, many = looks.colours[row.colours], True
    light = np.empty(3, np.float32)
    for axis in range(3):
        light[axis] = position[axis] + (
            rotation[axis, 0] * row.light_x + rotation[axis, 1] * row.light_y + rotation[axis, 2] * row.light_z
        )
    nearest_edge = _F(math.cos(math.radians(min(row.cutoff_deg, _F(180)))))
    for v in range(len(geometry.vertices_mm)):
        point, normal = geometry.vertices_mm[v], geometry.vertex_normals[v]
        x, y, z = light[0] - point[0], light[1] - point[1], light[2] - point[2]
        r = max(math.sqrt(x * x + y * y + z * z), _F(1e-9))
        x, y, z = x / r, y / r, z / r
        axial = -(x * rotation[0, 2] + y * rotation[1, 2] + z * rotation[2, 2])
        fall = _spot(row, axial, nearest_edge) / (row.constant + r * (row.linear + r * row.quadratic))
        cosine = x * normal[0] + y * normal[1] + z * normal[2]
        albedo = colours[v if many else 0]
        for side in range(2):
            facing = max(cosine if side == 0 else -cosine, _ZERO)
            red = row.ambient_r + fall * (row.spot_ambient_r + row.light_r * facing)
            green = row.ambient_g + fall * (row.spot_ambient_g + row.light_g * facing)
            blue = row.ambient_b + fall * (row.spot_ambient_b + row.light_b * facing)
            lit[side, v, 0] = _clip(albedo[0] * red, _ZERO, _ONE)
            lit[side, v, 1] = _clip(albedo[1] * green, _ZERO, _ONE)
            lit[side, v, 2] = _clip(albedo[2] * blue, _ZERO, _ONE)


@_fast_njit
def _spot(row, cosine, nearest_edge):
    """As `look.spot_strength`."""
    if row.cutoff_deg >= _F(180):
        return max(cosine, _ZERO) ** row.exponent if row.exponent != _ZERO else _ONE
    if cosine < nearest_edge:
        return _ZERO
    strength = max(cosine, _ZERO) ** row.exponent
    if row.edge_deg > _ZERO:
        angle_deg = _F(math.degrees(math.acos(_clip(cosine, -_ONE, _ONE))))
        t = _clip((row.cutoff_deg - angle_deg) / row.edge_deg, _ZERO, _ONE)
        strength *= t * t * (_F(3) - _TWO * t)
    return strength


@_fast_njit
def _filter(camera, row, scratch, out):
    """The sensor's five taps along the rows, then down the columns; border pixels are repeated."""
    height, width, span = camera.height, camera.width, 3 * camera.width
    grey, between, final = scratch.grey.reshape(-1), scratch.light.reshape(-1), out.reshape(-1)
    t0, t1, t2 = row.tap0, row.tap1, row.tap2
    for y in range(height):
        line, done = grey[y * span : (y + 1) * span], between[y * span : (y + 1) * span]
        for j in range(6, span - 6):
            done[j] = t0 * line[j] + t1 * (line[j - 3] + line[j + 3]) + t2 * (line[j - 6] + line[j + 6])
        for x in range(width):
            if 2 <= x < width - 2:
                continue
            left, lefter, right, righter = max(x - 1, 0), max(x - 2, 0), min(x + 1, width - 1), min(x + 2, width - 1)
            for c in range(3):
                near = line[3 * left + c] + line[3 * right + c]
                done[3 * x + c] = t0 * line[3 * x + c] + t1 * near + t2 * (line[3 * lefter + c] + line[3 * righter + c])
    for y in range(height):
        here = between[y * span : (y + 1) * span]
        up, down = between[max(y - 1, 0) * span :], between[min(y + 1, height - 1) * span :]
        upper, downer = between[max(y - 2, 0) * span :], between[min(y + 2, height - 1) * span :]
        target = final[y * span : (y + 1) * span]
        for j in range(span):
            value = t0 * here[j] + t1 * (up[j] + down[j]) + t2 * (upper[j] + downer[j])
            target[j] = np.uint8(_clip(value + _HALF, _ZERO, _F(255)))
