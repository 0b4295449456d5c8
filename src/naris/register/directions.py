"""Directions as texels of a square (octahedral maps), and rotations that a camera in a nose may have."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from naris.core.pose import Pose
from naris.render.directions import upright


def texels(directions: Float[np.ndarray, "*n 3"], size: int) -> Int[np.ndarray, "*n"]:
    """The texel of each direction in a square of size × size (Meyer et al. 2010, octahedron normal vectors)."""
    flat = directions / np.abs(directions).sum(axis=-1, keepdims=True)
    x, y, z = np.moveaxis(flat, -1, 0)
    u = np.where(z >= 0, x, (1 - np.abs(y)) * np.where(x >= 0, 1, -1))
    v = np.where(z >= 0, y, (1 - np.abs(x)) * np.where(y >= 0, 1, -1))
    column, row = (np.clip(((a + 1) / 2 * size).astype(np.int64), 0, size - 1) for a in (u, v))
    return row * size + column


def texel_directions(size: int) -> Float[np.ndarray, "t 3"]:
    """The unit direction of the middle of each texel."""
    middle = (np.arange(size) + 0.5) / size * 2 - 1
    v, u = np.meshgrid(middle, middle, indexing="ij")
    z = 1 - np.abs(u) - np.abs(v)
    x = np.where(z >= 0, u, (1 - np.abs(v)) * np.where(u >= 0, 1, -1))
    y = np.where(z >= 0, v, (1 - np.abs(u)) * np.where(v >= 0, 1, -1))
    d = np.stack([x, y, z], axis=-1).reshape(-1, 3)
    return d / np.linalg.norm(d, axis=1, keepdims=True)


def rotations(
    inward: Float[np.ndarray, "3"], tilt_deg: float, roll_deg: float, apart_deg: float
) -> Float[np.ndarray, "r 3 3"]:
    """Cameras that look within `tilt_deg` of inward and are rolled by up to `roll_deg` from upright.

    Their directions are about `apart_deg` apart (a Fibonacci lattice on the sphere), their rolls 1.6 times as much.
    """
    count = max(int(4 * np.pi / np.deg2rad(apart_deg) ** 2), 1)
    k = np.arange(count) + 0.5
    height, turn = 1 - 2 * k / count, np.pi * (1 + 5**0.5) * k
    radius = np.sqrt(1 - height**2)
    forward = np.stack([radius * np.cos(turn), radius * np.sin(turn), height], axis=1)
    forward = forward[forward @ inward >= np.cos(np.deg2rad(tilt_deg))]
    steps = max(round(roll_deg / (1.6 * apart_deg)), 0)
    rolls = np.linspace(-roll_deg, roll_deg, 2 * steps + 1) if steps else np.zeros(1)
    if roll_deg >= 180:
        rolls = rolls[1:]
    all_forward, roll = np.tile(forward, (len(rolls), 1)), np.repeat(np.deg2rad(rolls), len(forward))
    return Pose.look(np.zeros_like(all_forward), all_forward, upright(all_forward), "anatomy", roll).rotation
