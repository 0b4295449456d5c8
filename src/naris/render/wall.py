# ruff: noqa: ANN001, ANN201, ANN202
# mypy: ignore-errors
"""What the wall sends back, sixteen pixels at once: `naris.render.shading` for the compiled kernel."""

from __future__ import annotations

import numpy as np
from numba import njit

from naris.render.lanes import LANES, choose, gather, least, load, magnitude, most, real, sqrt, store, whole
from naris.render.look import RAMP_BLOOD, RAMP_SIZE, SPOT_SIZE
from naris.render.noise import EDGE, STEPS
from naris.render.shading import SHALLOWEST_COSINE

_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False, _nrt=False, forceinline=True)
_EDGE_BITS = EDGE.bit_length() - 1
_VOLUME = EDGE**3


@_njit
def _clip(x, low, high):
    return least(most(x, low), high)


@_njit
def lookup(table, offset, size, at):
    """Linear interpolation in `size` entries of a flat table from `offset` on, clamped at its ends."""
    at = _clip(at, 0.0, np.float32(size - 1.001))
    low = whole(at)
    first = gather(table, low + offset)
    return first + (at - real(low)) * (gather(table, low + (offset + 1)) - first)


@_njit
def interpolated_normal(surface, face, u, v, side):
    """Unit normal between the corners of a face, on the side that is seen."""
    n, at, w = surface.corner_normals, face * 9, 1.0 - u - v
    x = w * gather(n, at) + u * gather(n, at + 3) + v * gather(n, at + 6)
    y = w * gather(n, at + 1) + u * gather(n, at + 4) + v * gather(n, at + 7)
    z = w * gather(n, at + 2) + u * gather(n, at + 5) + v * gather(n, at + 8)
    scale = side / sqrt(most(x * x + y * y + z * z, np.float32(1e-24)))
    return x * scale, y * scale, z * scale


@_njit
def interpolated_colour(surface, colours, offset, face, u, v):
    """Colours between the corners of a face; `offset` (lanes or a number) is where the planes of a colour begin."""
    size, w = surface.vertices.shape[1], 1.0 - u - v
    a = gather(surface.faces, face * 3) + offset
    b = gather(surface.faces, face * 3 + 1) + offset
    c = gather(surface.faces, face * 3 + 2) + offset
    red = w * gather(colours, a) + u * gather(colours, b) + v * gather(colours, c)
    a, b, c = a + size, b + size, c + size
    green = w * gather(colours, a) + u * gather(colours, b) + v * gather(colours, c)
    a, b, c = a + size, b + size, c + size
    return red, green, w * gather(colours, a) + u * gather(colours, b) + v * gather(colours, c)


@_njit
def _corner(total, bank, at, weight):
    """Adds the four bytes of a voxel, each as a signed number times the weight."""
    word = gather(bank, at)
    return (
        total[0] + weight * real((word << 24) >> 24),
        total[1] + weight * real((word << 16) >> 24),
        total[2] + weight * real((word << 8) >> 24),
        total[3] + weight * real(word >> 24),
    )


@_njit
def _trilinear(bank, offset, x, y, z):
    """Four fields of a periodic volume at a point in voxels, positive."""
    x0, y0, z0 = whole(x), whole(y), whole(z)
    tx, ty, tz = x - real(x0), y - real(y0), z - real(z0)
    x1, y1, z1 = ((x0 + 1) & (EDGE - 1)), ((y0 + 1) & (EDGE - 1)), ((z0 + 1) & (EDGE - 1))
    x0, y0, z0 = (x0 & (EDGE - 1)), (y0 & (EDGE - 1)), (z0 & (EDGE - 1))
    x0, x1 = (x0 << (2 * _EDGE_BITS)) + offset, (x1 << (2 * _EDGE_BITS)) + offset
    y0, y1 = y0 << _EDGE_BITS, y1 << _EDGE_BITS
    sz, xy = 1.0 - tz, tx * ty
    w00, w01, w10 = 1.0 - tx - ty + xy, ty - xy, tx - xy
    zero = x * 0.0
    total = (zero, zero, zero, zero)
    total = _corner(total, bank, x0 + y0 + z0, w00 * sz)
    total = _corner(total, bank, x0 + y0 + z1, w00 * tz)
    total = _corner(total, bank, x0 + y1 + z0, w01 * sz)
    total = _corner(total, bank, x0 + y1 + z1, w01 * tz)
    total = _corner(total, bank, x1 + y0 + z0, w10 * sz)
    total = _corner(total, bank, x1 + y0 + z1, w10 * tz)
    total = _corner(total, bank, x1 + y1 + z0, xy * sz)
    total = _corner(total, bank, x1 + y1 + z1, xy * tz)
    step = np.float32(1 / STEPS)
    return total[0] * step, total[1] * step, total[2] * step, total[3] * step


@_njit
def _line(field, width, coarse):
    """1 on the zero line of a field, 0 beyond a half width; wider and weaker where a pixel spans `coarse` voxels."""
    blur = 0.5 * coarse
    seen = 1.0 / sqrt(width * width + blur * blur)
    t = most(1.0 - magnitude(field) * seen, 0.0)
    return t * t * (3.0 - 2.0 * t) * (width * seen)


@_njit
def mucosa(bank, ramp, i, row, point, pixel_mm, normal):
    """Albedo of a mucosa, and the normal turned by its relief."""
    px, py, pz = point
    x = row.m00 * px + row.m01 * py + row.m02 * pz
    y = row.m10 * px + row.m11 * py + row.m12 * pz
    z = row.m20 * px + row.m21 * py + row.m22 * pz
    coarse, spread = pixel_mm * row.relief_per_mm, pixel_mm * row.tissue_per_mm
    fade = 1.0 / (1.0 + coarse * coarse * np.float32(1 / 16))
    per_mm, tissue = row.relief_per_mm, 2 * row.bank * _VOLUME
    fine, gx, gy, gz = _trilinear(
        bank, tissue + _VOLUME, x * per_mm + row.relief_x, y * per_mm + row.relief_y, z * per_mm + row.relief_z
    )
    gx, gy, gz = gx * fade, gy * fade, gz * fade
    per_mm = row.tissue_per_mm
    blotch, change, large, small = _trilinear(
        bank, tissue, x * per_mm + row.tissue_x, y * per_mm + row.tissue_y, z * per_mm + row.tissue_z
    )
    width = row.vessel * _clip(0.5 + 0.5 * change, 0.05, 1.5)
    narrow = row.fine_vessel * _clip(0.6 - 0.6 * change, 0.05, 1.5)
    blood = row.blood + row.blotches * blotch + row.fine_vessels * _line(fine, narrow, coarse)
    blood += row.vessels * (_line(large, width, spread) + 0.6 * _line(small, 0.6 * width, spread))
    at, begin = blood * np.float32((RAMP_SIZE - 1) / RAMP_BLOOD), 3 * i * RAMP_SIZE
    r = lookup(ramp, begin, RAMP_SIZE, at)
    g = lookup(ramp, begin + RAMP_SIZE, RAMP_SIZE, at)
    b = lookup(ramp, begin + 2 * RAMP_SIZE, RAMP_SIZE, at)
    cover = row.mucus * _clip(0.5 - 0.5 * blotch + 0.5 * change, 0.0, 1.0)
    albedo = (r + cover * (row.mucus_r - r), g + cover * (row.mucus_g - g), b + cover * (row.mucus_b - b))
    return albedo, _turned(row, (gx, gy, gz), normal)


@_njit
def _turned(row, slope, normal):
    """The normal of a wall with relief: less the part of the slope along the wall."""
    gx, gy, gz = slope
    nx, ny, nz = normal
    x = row.m00 * gx + row.m10 * gy + row.m20 * gz
    y = row.m01 * gx + row.m11 * gy + row.m21 * gz
    z = row.m02 * gx + row.m12 * gy + row.m22 * gz
    along = x * nx + y * ny + z * nz
    nx, ny, nz = (
        nx - row.relief * (x - along * nx),
        ny - row.relief * (y - along * ny),
        nz - row.relief * (z - along * nz),
    )
    scale = 1.0 / sqrt(most(nx * nx + ny * ny + nz * nz, np.float32(1e-24)))
    return nx * scale, ny * scale, nz * scale


@_njit
def lamp_of(row, r):
    """From the camera to the light, and the light's axis, in the anatomy."""
    x = r[0, 0] * row.light_x + r[0, 1] * row.light_y + r[0, 2] * row.light_z
    y = r[1, 0] * row.light_x + r[1, 1] * row.light_y + r[1, 2] * row.light_z
    z = r[2, 0] * row.light_x + r[2, 1] * row.light_y + r[2, 2] * row.light_z
    return x, y, z, r[0, 2], r[1, 2], r[2, 2]


@_njit
def _fall(row, spot, i, distance, axial):
    """What distance and angle to the spot's axis leave of its light."""
    at = (1.0 - axial) * np.float32((SPOT_SIZE - 1) / 2)
    strength = lookup(spot, i * SPOT_SIZE, SPOT_SIZE, at)
    strength = choose(axial >= row.cosine_cut, strength, 0.0)
    return strength / (row.constant + distance * (row.linear + distance * row.quadratic))


@_njit
def light_back(spot, i, row, lamp, way, normal, albedo):
    """The light that comes back to the camera, `way` being the rays' lengths and directions."""
    t, dx, dy, dz = way
    nx, ny, nz = normal
    lx, ly, lz = lamp[0] - t * dx, lamp[1] - t * dy, lamp[2] - t * dz
    squared = lx * lx + ly * ly + lz * lz
    inverse = 1.0 / sqrt(squared)
    lx, ly, lz = lx * inverse, ly * inverse, lz * inverse
    cosine = _clip(nx * lx + ny * ly + nz * lz, np.float32(SHALLOWEST_COSINE), 1.0)
    fall = _fall(row, spot, i, squared * inverse, -(lx * lamp[3] + ly * lamp[4] + lz * lamp[5]))
    shine = fall * 0.0
    if row.gloss > 0.0 or row.sheen > 0.0:
        hx, hy, hz = lx - dx, ly - dy, lz - dz
        facing = most(nx * hx + ny * hy + nz * hz, 0.0)
        facing = least(facing * facing / most(hx * hx + hy * hy + hz * hz, np.float32(1e-12)), 1.0)
        wet = row.film / (1.0 - facing * (1.0 - row.film))
        dull = row.tissue / (1.0 - facing * (1.0 - row.tissue))
        shine = fall * (row.gloss * wet * wet + row.sheen * dull * dull)
    one, bounce = np.float32(1), row.bounce
    red = row.spot_ambient_r + row.light_r * ((cosine + row.wrap_r) * (one / (one + row.wrap_r)) + bounce * albedo[0])
    green = row.spot_ambient_g + row.light_g * ((cosine + row.wrap_g) * (one / (one + row.wrap_g)) + bounce * albedo[1])
    blue = row.spot_ambient_b + row.light_b * ((cosine + row.wrap_b) * (one / (one + row.wrap_b)) + bounce * albedo[2])
    return (
        albedo[0] * (row.ambient_r + fall * red) + shine * row.light_r,
        albedo[1] * (row.ambient_g + fall * green) + shine * row.light_g,
        albedo[2] * (row.ambient_b + fall * blue) + shine * row.light_b,
    )


@_njit
def light_vertices(surface, spot, i, row, position, lamp, lit):
    """As `shading.light_vertices`; `lit` holds the outside's red, green and blue planes, then the inside's."""
    points, size = surface.vertices, surface.vertices.shape[1]
    ox, oy, oz = position[0] + lamp[0], position[1] + lamp[1], position[2] + lamp[2]
    first = 3 * max(row.colours, 0) * size
    for at in range(0, size, LANES):
        x, y, z = ox - load(points, at), oy - load(points, size + at), oz - load(points, 2 * size + at)
        distance = most(sqrt(x * x + y * y + z * z), np.float32(1e-9))
        x, y, z = x / distance, y / distance, z / distance
        fall = _fall(row, spot, i, distance, -(x * lamp[3] + y * lamp[4] + z * lamp[5]))
        cosine = x * load(points, 3 * size + at) + y * load(points, 4 * size + at) + z * load(points, 5 * size + at)
        r, g, b = fall * 0.0 + row.albedo_r, fall * 0.0 + row.albedo_g, fall * 0.0 + row.albedo_b
        if row.colours >= 0:
            r = load(surface.colours, first + at)
            g = load(surface.colours, first + size + at)
            b = load(surface.colours, first + 2 * size + at)
        for side in range(2):
            facing, to = most(cosine if side == 0 else -cosine, 0.0), 3 * side * size + at
            red = row.ambient_r + fall * (row.spot_ambient_r + row.light_r * facing)
            green = row.ambient_g + fall * (row.spot_ambient_g + row.light_g * facing)
            blue = row.ambient_b + fall * (row.spot_ambient_b + row.light_b * facing)
            store(lit, to, _clip(r * red, 0.0, 1.0))
            store(lit, to + size, _clip(g * green, 0.0, 1.0))
            store(lit, to + 2 * size, _clip(b * blue, 0.0, 1.0))
