"""The compiled loops behind `crossings`, without the interpreter lock.

Which side of a plane a point lies on is the sign of a determinant; where rounding could have turned it (J. Shewchuk,
"Adaptive precision floating-point arithmetic and fast robust geometric predicates", 1997, section 4.3, bound A) the
point counts as lying in the plane. Arrays: `t` (F, 3, 3) corners in mm, `faces` (F, 3) vertex numbers.
"""
# ruff: noqa: ANN001, ANN201, ANN202, PLR0913, SIM110
# mypy: disable-error-code="no-untyped-def, no-untyped-call, untyped-decorator"

from __future__ import annotations

import numpy as np
from numba import njit

_BOUND = 7.77156117237609e-16  # (7 + 56 ε) ε with ε = 2⁻⁵³
_BOUND_2 = 3.3306690738754716e-16  # (3 + 16 ε) ε, of the same in the plane
_SLACK = 1e-14  # many times the rounding of a height above a plane


@njit(cache=True, nogil=True)
def _side(t, f, a, b, g, c, h, d):
    """The side of the plane through corners a and b of f and corner c of g on which corner d of h lies: −1, 0, 1."""
    x, y, z = t[h, d, 0], t[h, d, 1], t[h, d, 2]
    ax, ay, az = t[f, a, 0] - x, t[f, a, 1] - y, t[f, a, 2] - z
    bx, by, bz = t[f, b, 0] - x, t[f, b, 1] - y, t[f, b, 2] - z
    cx, cy, cz = t[g, c, 0] - x, t[g, c, 1] - y, t[g, c, 2] - z
    bxcy, cxby, cxay, axcy, axby, bxay = bx * cy, cx * by, cx * ay, ax * cy, ax * by, bx * ay
    value = az * (bxcy - cxby) + bz * (cxay - axcy) + cz * (axby - bxay)
    size = (abs(bxcy) + abs(cxby)) * abs(az) + (abs(cxay) + abs(axcy)) * abs(bz) + (abs(axby) + abs(bxay)) * abs(cz)
    if abs(value) <= _BOUND * size:
        return 0
    return 1 if value > 0.0 else -1


@njit(cache=True, nogil=True)
def _side_2(t, f, a, b, g, c, u, v):
    """The same in the plane of the axes u and v: on which side of the line from a to b corner c of g lies."""
    left = (t[f, a, u] - t[g, c, u]) * (t[f, b, v] - t[g, c, v])
    right = (t[f, a, v] - t[g, c, v]) * (t[f, b, u] - t[g, c, u])
    value = left - right
    if abs(value) <= _BOUND_2 * (abs(left) + abs(right)):
        return 0
    return 1 if value > 0.0 else -1


@njit(cache=True, nogil=True)
def _sides(t, f, g, shared):
    """The lowest and the highest side of the plane of f on which a corner of g lies; corner `shared` lies in it."""
    low, high = (1, -1) if shared < 0 else (0, 0)
    for k in range(3):
        if k != shared:
            side = _side(t, f, 0, 1, f, 2, g, k)
            low, high = min(low, side), max(high, side)
    return low, high


@njit(cache=True, nogil=True)
def _pierces(t, f, e, g, shared):
    """Whether the edge of f from corner e on passes through g; `shared` is the corner of g that f has too, or −1.

    Its ends must lie on either side of g; it may pass through the rim of g, but not through a shared corner alone.
    """
    n = (e + 1) % 3
    if _side(t, g, 0, 1, g, 2, f, e) * _side(t, g, 0, 1, g, 2, f, n) >= 0:
        return False
    least, most = 1, -1
    through_shared = shared >= 0
    for k in range(3):
        way = _side(t, f, e, n, g, k, g, (k + 1) % 3)
        least, most = min(least, way), max(most, way)
        if way != 0 and (shared == k or shared == (k + 1) % 3):
            through_shared = False
    return least * most >= 0 and not through_shared


@njit(cache=True, nogil=True)
def _flat_axes(t, f):
    """The two axes across which triangle f is seen largest."""
    best, u, v = -1.0, 0, 1
    for p in range(3):
        q = (p + 1) % 3
        area = abs(
            (t[f, 1, p] - t[f, 0, p]) * (t[f, 2, q] - t[f, 0, q])
            - (t[f, 1, q] - t[f, 0, q]) * (t[f, 2, p] - t[f, 0, p])
        )
        if area > best:
            best, u, v = area, p, q
    return u, v


@njit(cache=True, nogil=True)
def _apart(t, f, g, u, v):
    """Whether a side of f, in a plane with g, has all of g on its other side or on itself."""
    for k in range(3):
        n = (k + 1) % 3
        own = _side_2(t, f, k, n, f, (k + 2) % 3, u, v)
        if own == 0:  # without area there
            return True
        beyond = True
        for c in range(3):
            beyond = beyond and _side_2(t, f, k, n, g, c, u, v) * own <= 0
        if beyond:
            return True
    return False


@njit(cache=True, nogil=True)
def _overlap_flat(t, f, g):
    """Whether two triangles of one plane lie on each other there."""
    u, v = _flat_axes(t, f)
    return not _apart(t, f, g, u, v) and not _apart(t, g, f, u, v)


@njit(cache=True, nogil=True)
def _shared(faces, f, g):
    """How many vertices f and g have in common, and which corners of f and of g the last of them is."""
    count, of_f, of_g = 0, -1, -1
    for p in range(3):
        for q in range(3):
            if faces[f, p] == faces[g, q]:
                count, of_f, of_g = count + 1, p, q
    return count, of_f, of_g


@njit(cache=True, nogil=True)
def _faces_cross(t, faces, f, g):
    """Whether faces f and g have more in common than the vertices that both have."""
    count, of_f, of_g = _shared(faces, f, g)
    low, high = _sides(t, f, g, of_g)
    if low == 0 and high == 0:
        return _overlap_flat(t, f, g)
    if low * high >= 0 or count >= 2:
        return False
    low, high = _sides(t, g, f, of_f)
    if low * high >= 0:
        return False
    if count == 1:  # then the edge across must pass through the other
        return _pierces(t, f, (of_f + 1) % 3, g, of_g) or _pierces(t, g, (of_g + 1) % 3, f, of_f)
    for k in range(3):
        if _pierces(t, f, k, g, -1) or _pierces(t, g, k, f, -1):
            return True
    return False


@njit(cache=True, nogil=True)
def _all_beside(t, planes, f, g, shared):
    """Whether g, but for so many shared corners, surely lies on one side of the plane of f."""
    x, y, z = t[f, 0, 0], t[f, 0, 1], t[f, 0, 2]
    above, below = 0, 0
    for k in range(3):
        dx, dy, dz = t[g, k, 0] - x, t[g, k, 1] - y, t[g, k, 2] - z
        height = planes[f, 0] * dx + planes[f, 1] * dy + planes[f, 2] * dz
        slack = planes[f, 3] * (abs(dx) + abs(dy) + abs(dz))
        above += height > slack
        below += height < -slack
    return shared < 3 and max(above, below) + shared == 3


@njit(cache=True, nogil=True)
def _cross(t, faces, planes, f, g):
    """`_faces_cross`, which is asked only where it is not plain that they do not."""
    shared = 0
    for p in range(3):
        for q in range(3):
            shared += faces[f, p] == faces[g, q]
    if _all_beside(t, planes, f, g, shared) or _all_beside(t, planes, g, f, shared):
        return False
    return _faces_cross(t, faces, f, g)


@njit(cache=True, nogil=True)
def _planes(t):
    """The normal of each face, twice its area long, and how far rounding may have turned a height by, in each mm."""
    planes = np.empty((len(t), 4))
    for f in range(len(t)):
        ux, uy, uz = t[f, 1, 0] - t[f, 0, 0], t[f, 1, 1] - t[f, 0, 1], t[f, 1, 2] - t[f, 0, 2]
        vx, vy, vz = t[f, 2, 0] - t[f, 0, 0], t[f, 2, 1] - t[f, 0, 1], t[f, 2, 2] - t[f, 0, 2]
        planes[f, 0], planes[f, 1], planes[f, 2] = uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
        planes[f, 3] = _SLACK * (abs(ux) + abs(uy) + abs(uz)) * (abs(vx) + abs(vy) + abs(vz))
    return planes


@njit(cache=True, nogil=True)
def crossing_in_strips(t, faces, boxes, strips, start, members, asked, most):
    """Pairs of faces that cross, at most so many, of which one at least is asked for.

    `boxes` (F, 6) holds the low and the high corner of each face, `strips` (F,) the first strip across the second axis
    that it reaches into; `members[start[s]:start[s + 1]]` are the faces of strip s by the low end of their boxes along
    the first axis.
    """
    pairs, found, planes = np.empty((64, 2), dtype=np.int64), 0, _planes(t)
    for s in range(len(start) - 1):
        for a in range(start[s], start[s + 1]):
            f = members[a]
            for b in range(a + 1, start[s + 1]):
                g = members[b]
                if boxes[g, 0] > boxes[f, 3]:
                    break
                if not (asked[f] or asked[g]):
                    continue
                if boxes[g, 1] > boxes[f, 4] or boxes[g, 4] < boxes[f, 1]:
                    continue
                if boxes[g, 2] > boxes[f, 5] or boxes[g, 5] < boxes[f, 2]:
                    continue
                if max(strips[f], strips[g]) != s or not _cross(t, faces, planes, f, g):  # each pair in one strip only
                    continue
                if found == len(pairs):
                    more = np.empty((2 * found, 2), dtype=np.int64)
                    more[:found] = pairs
                    pairs = more
                pairs[found, 0], pairs[found, 1] = f, g
                found += 1
                if found == most:
                    return pairs[:found]
    return pairs[:found]
