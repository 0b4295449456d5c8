"""A closed surface without symmetry, and clouds of it, for the tests of this room."""

from __future__ import annotations

import numpy as np

from naris.core.pose import Pose
from naris.register.likely_point.surface import Surface, surface_from

FRAME, CLOUD = "bumpy", "cloud"


def bumpy(step_deg: float = 9.0) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (mm) and faces of a ball of 10 mm with bumps, outward."""
    theta = np.linspace(0, np.pi, round(180 / step_deg) + 1)[1:-1]
    phi = np.arange(0, 2 * np.pi, np.deg2rad(step_deg))
    t, p = (each.ravel() for each in np.meshgrid(theta, phi, indexing="ij"))
    way = np.stack([np.sin(t) * np.cos(p), np.sin(t) * np.sin(p), np.cos(t)], axis=1)
    way = np.vstack([way, [[0, 0, 1], [0, 0, -1]]])
    x, y, z = way.T
    radius = 10 + 1.5 * np.sin(3 * x + 1) * y + 2.0 * np.sin(4 * y) * z + 1.2 * x * np.cos(5 * z)
    rows, columns = len(theta), len(phi)
    ring = np.arange(rows * columns).reshape(rows, columns)
    after = np.roll(ring, -1, axis=1)
    a, b, c, d = ring[:-1].ravel(), ring[1:].ravel(), after[1:].ravel(), after[:-1].ravel()
    top, bottom = np.full(columns, rows * columns), np.full(columns, rows * columns + 1)
    faces = np.vstack(
        [
            np.column_stack([a, b, c]),
            np.column_stack([a, c, d]),
            np.column_stack([top, ring[0], after[0]]),
            np.column_stack([bottom, after[-1], ring[-1]]),
        ]
    )
    return way * radius[:, None], faces.astype(np.int32)


def prepared(step_deg: float = 9.0) -> Surface:
    return surface_from(*bumpy(step_deg), FRAME)


def sampled(count: int, rng: np.random.Generator, step_deg: float = 9.0) -> tuple[np.ndarray, np.ndarray]:
    """Points all over the surface, and their normals."""
    vertices, faces = bumpy(step_deg)
    corners = vertices[faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1)
    chosen = rng.choice(len(faces), count, p=area / area.sum())
    weights = rng.dirichlet(np.ones(3), count)
    return np.einsum("nc,nck->nk", weights, corners[chosen]), (cross / area[:, None])[chosen]


def moved(rng: np.random.Generator, mm: float, rad: float) -> Pose:
    return Pose.exp(np.concatenate([mm * rng.standard_normal(3), rad * rng.standard_normal(3)]), FRAME, CLOUD)


def covariances(count: int, rng: np.random.Generator) -> np.ndarray:
    """Long and flat, every way."""
    axes, _ = np.linalg.qr(rng.standard_normal((count, 3, 3)))
    return np.einsum("nij,nj,nkj->nik", axes, rng.uniform(0.05, 2.0, (count, 3)) ** 2, axes)
