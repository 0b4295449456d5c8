"""Where a camera in a passage looks: along it, back to its middle, and which side is up."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from naris.anatomy.distance import SignedDistance
from naris.core.anatomy import Passage
from naris.render.keyframes import UP

POSTERIOR = (0.0, 1.0, 0.0)
_TANGENT_SD_MM = 8.0
_SIGHT_SAMPLES = 12
_PULL = 0.5


def upright(forward: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3"]:
    """What is up for a camera that looked straight back (+y) with +z up and was turned the shortest way.

    Unlike a fixed +z it has no pole at the views up and down, where a vestibule starts; it has one looking out (−y).
    Near the horizontal they agree to second order.
    """
    forward = np.asarray(forward, dtype=np.float64)
    back, up = np.array(POSTERIOR), np.array(UP)
    along, lift = forward @ back, forward @ up
    # Rodrigues' rotation that takes `back` to `forward`, applied to `up`, which is orthogonal to `back`.
    return up - (lift / np.maximum(1 + along, 1e-9))[..., None] * (forward + back)


@dataclass(frozen=True, eq=False)
class Bearings:
    """How M places stand to the nearest passage that each can see.

    Attributes:
        passage: (M,) its number.
        way: (M, 3) its unit direction inwards.
        goal_mm: (M, 3) its nearest point.
        depth_mm: (M,) its length up to there.
    """

    passage: Int[np.ndarray, "m"]
    way: Float[np.ndarray, "m 3"]
    goal_mm: Float[np.ndarray, "m 3"]
    depth_mm: Float[np.ndarray, "m"]


def bearings(places_mm: Float[np.ndarray, "m 3"], distance: SignedDistance, passages: Sequence[Passage]) -> Bearings:
    """Find the nearest passage in sight of each place.

    In sight means that the straight line there stays inside the lumen; a place that sees none takes the nearest.
    """
    from scipy.spatial import cKDTree

    nearest = [cKDTree(passage.points_mm).query(places_mm) for passage in passages]
    order = np.argsort(np.stack([reach for reach, _ in nearest], axis=1), axis=1, kind="stable")
    goals = np.stack([p.points_mm[index] for p, (_, index) in zip(passages, nearest, strict=True)], axis=1)
    ways = np.stack([tangents(p)[index] for p, (_, index) in zip(passages, nearest, strict=True)], axis=1)
    depths = np.stack([_lengths_mm(p)[index] for p, (_, index) in zip(passages, nearest, strict=True)], axis=1)
    chosen = order[:, 0].copy()
    blind = np.arange(len(places_mm))
    for rank in range(len(passages)):
        goal = goals[blind, order[blind, rank]]
        seen = _in_sight(distance, places_mm[blind], goal)
        chosen[blind[seen]] = order[blind[seen], rank]
        blind = blind[~seen]
    every = np.arange(len(places_mm))
    return Bearings(chosen, ways[every, chosen], goals[every, chosen], depths[every, chosen])


def aims(
    ways: Float[np.ndarray, "n 3"], back_mm: Float[np.ndarray, "n 3"], ahead_mm: float
) -> Float[np.ndarray, "n 3"]:
    """Unit directions along passages that lie `back_mm` away, and back to them: half of the way within `ahead_mm`."""
    aim = ahead_mm * ways + _PULL * back_mm
    return aim / np.linalg.norm(aim, axis=1, keepdims=True)


def tangents(passage: Passage) -> Float[np.ndarray, "n 3"]:
    """The unit direction of a passage at each of its points, smoothed over about 8 mm.

    Within a slit a minimal path wanders up and down; nobody points a scope along that.
    """
    from scipy.ndimage import gaussian_filter1d

    points = passage.points_mm
    step_mm = max(passage.length_mm / max(len(points) - 1, 1), 1e-6)
    smooth = gaussian_filter1d(points, _TANGENT_SD_MM / step_mm, axis=0, mode="nearest")
    way = np.gradient(smooth, axis=0)
    return way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-12)


def tilted(
    directions: Float[np.ndarray, "n 3"], tilt_rad: Float[np.ndarray, "n"], rng: np.random.Generator
) -> Float[np.ndarray, "n 3"]:
    """Unit directions, each turned by its angle towards a random side."""
    across = np.cross(directions, np.eye(3)[np.abs(directions).argmin(axis=1)])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    side = rng.uniform(0, 2 * np.pi, len(directions))[:, None]
    sideways = np.cos(side) * across + np.sin(side) * np.cross(directions, across)
    return np.cos(tilt_rad)[:, None] * directions + np.sin(tilt_rad)[:, None] * sideways


def _lengths_mm(passage: Passage) -> Float[np.ndarray, "n"]:
    """Of the passage up to each of its points."""
    steps = np.linalg.norm(np.diff(passage.points_mm, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _in_sight(
    distance: SignedDistance, start: Float[np.ndarray, "m 3"], goal: Float[np.ndarray, "m 3"]
) -> Bool[np.ndarray, "m"]:
    share = np.linspace(0, 1, _SIGHT_SAMPLES + 1)[1:, None, None]
    return np.asarray((distance(start + share * (goal - start)) > 0).all(axis=0))
