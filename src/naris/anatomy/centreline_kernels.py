"""The compiled loop behind `centreline`, without the interpreter lock."""
# ruff: noqa: ANN001, ANN201
# mypy: disable-error-code="no-untyped-def, no-untyped-call, untyped-decorator"

from __future__ import annotations

import numpy as np
from numba import njit

from naris.anatomy.kernels import value_at


@njit(cache=True, nogil=True)
def relax(points, least, lattice, rounds, smoothing, centring, ample):
    """Moves the inner points (N, 3) towards the middle of their neighbours and of the lumen, all at once.

    A point stays where its clearance would fall below `least` (N,). `lattice` is the values, the origin and the spacing
    of a distance grid; the wall draws on points with less than `ample` mm of clearance, across the line only.
    """
    values, origin, spacing = lattice
    half = 0.5 * spacing
    before = points.copy()
    for _ in range(rounds):
        before[:] = points
        for n in range(1, len(points) - 1):
            x, y, z = before[n, 0], before[n, 1], before[n, 2]
            tx = before[n + 1, 0] - before[n - 1, 0]
            ty = before[n + 1, 1] - before[n - 1, 1]
            tz = before[n + 1, 2] - before[n - 1, 2]
            length = max(np.sqrt(tx * tx + ty * ty + tz * tz), 1e-12)
            tx, ty, tz = tx / length, ty / length, tz / length
            near = max(1.0 - value_at(x, y, z, values, origin, spacing) / ample, 0.0)
            ahead = value_at(x + half, y, z, values, origin, spacing)
            px = (ahead - value_at(x - half, y, z, values, origin, spacing)) / spacing * near
            ahead = value_at(x, y + half, z, values, origin, spacing)
            py = (ahead - value_at(x, y - half, z, values, origin, spacing)) / spacing * near
            ahead = value_at(x, y, z + half, values, origin, spacing)
            pz = (ahead - value_at(x, y, z - half, values, origin, spacing)) / spacing * near
            along = px * tx + py * ty + pz * tz
            px, py, pz = px - along * tx, py - along * ty, pz - along * tz
            mx = x + smoothing * (0.5 * (before[n - 1, 0] + before[n + 1, 0]) - x) + centring * px
            my = y + smoothing * (0.5 * (before[n - 1, 1] + before[n + 1, 1]) - y) + centring * py
            mz = z + smoothing * (0.5 * (before[n - 1, 2] + before[n + 1, 2]) - z) + centring * pz
            if value_at(mx, my, mz, values, origin, spacing) >= least[n]:
                points[n, 0], points[n, 1], points[n, 2] = mx, my, mz
