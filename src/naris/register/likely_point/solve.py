"""Levenberg–Marquardt over poses, each step matched anew, while the misalignment is counted as noise."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from naris.core.pose import Pose
from naris.register.likely_point.average import Nodes
from naris.register.likely_point.averaged import averaged, nodes_for
from naris.register.likely_point.likelihood import ALIGNED, Cloud, Likelihood, Misalignment, likelihood
from naris.register.likely_point.match import Tree

_DAMPING, _LEAST_DAMPING, _MOST_DAMPING, _LOOSER, _TIGHTER = 1e-3, 1e-7, 1e8, 0.2, 5.0
_ANYWHERE = Misalignment(1e4, 1e4)
_NEGLIGIBLE = Misalignment(1e-4, 1e-6)
_SPARE = 1e-12  # of curvature, where a pose is not told at all


@dataclass(frozen=True)
class PointsConfig:
    """How a cloud is solved.

    Attributes:
        steps: at most so many.
        still_mm, still_rad: a step shorter than both ends it.
        anneal: count what the pose is off by as noise while it is; else the noise is from the first step what was said.
        shrink: what is counted falls to this share at least from step to step.
        average: end with the likelihood over the whole surface, not at the best matches alone.
    """

    steps: int = 100
    still_mm: float = 1e-5
    still_rad: float = 1e-6
    anneal: bool = True
    shrink: float = 0.7
    average: bool = False


class Solved(NamedTuple):
    """The pose (4, 4) from the cloud to the surface, how likely the cloud is there, and how it came to it."""

    pose: Float[np.ndarray, "4 4"]
    at: Likelihood
    converged: bool
    iterations: int


class _Problem(NamedTuple):
    """A cloud and a surface; with nodes the likelihood is that over all of it."""

    tree: Tree
    cloud: Cloud
    nodes: Nodes | None = None

    def at(self, pose: Float[np.ndarray, "4 4"], rows: Int[np.ndarray, "n"], off: Misalignment) -> Likelihood:
        if self.nodes is None:
            return likelihood(self.tree, self.cloud, pose, off, rows)
        return averaged(self.tree, self.nodes, self.cloud, pose, rows)


def solve(tree: Tree, cloud: Cloud, pose: Float[np.ndarray, "4 4"], config: PointsConfig) -> Solved:
    """The most likely pose near one.

    Raises:
        InputError: if the likelihood cannot be averaged over triangles that large.
    """
    of_matches = _Problem(tree, cloud)
    rows, off = np.zeros(len(cloud.points), np.int64), ALIGNED
    if config.anneal:
        rough = of_matches.at(pose, rows, _ANYWHERE)
        rows, off = rough.found.rows, _left_over(of_matches, pose, rough)
    found = _descended(of_matches, Solved(pose, of_matches.at(pose, rows, off), False, 0), off, config)
    if not config.average:
        return found
    of_all = _Problem(tree, cloud, nodes_for(tree, cloud))
    begun = found._replace(at=of_all.at(found.pose, found.at.found.rows, ALIGNED))
    return _descended(of_all, begun, ALIGNED, config)


def _descended(problem: _Problem, begun: Solved, off: Misalignment, config: PointsConfig) -> Solved:
    """Steps that make the cost fall, until they are small and no misalignment is left."""
    pose, at, damping, last = begun.pose, begun.at, _DAMPING, begun.iterations + config.steps
    for iteration in range(begun.iterations + 1, last + 1):
        step = -np.linalg.solve(at.matrix + np.diag(damping * np.diag(at.matrix) + _SPARE), at.gradient)
        there = pose @ Pose.exp(step, "", "").matrix
        after = problem.at(there, at.found.rows, off)
        still = np.linalg.norm(step[:3]) < config.still_mm and np.linalg.norm(step[3:]) < config.still_rad
        if after.cost <= at.cost:
            pose, at, damping = there, after, max(damping * _LOOSER, _LEAST_DAMPING)
        else:
            damping *= _TIGHTER
        if off != ALIGNED:
            off = _left_over(problem, pose, at, off, config.shrink)
            at = problem.at(pose, at.found.rows, off)
        elif still or damping > _MOST_DAMPING:
            return Solved(pose, at, True, iteration)
    return Solved(pose, problem.at(pose, at.found.rows, ALIGNED), False, last)


def _left_over(
    problem: _Problem,
    pose: Float[np.ndarray, "4 4"],
    at: Likelihood,
    before: Misalignment = Misalignment(np.inf, np.inf),
    shrink: float = 1.0,
) -> Misalignment:
    """What the noise does not explain of the distances and angles of the matches."""
    axes, rotation = problem.cloud.axes, pose[:3, :3]
    off = at.places - (problem.cloud.points @ rotation.T + pose[:3, 3])
    mm2 = float(np.average(np.square(off).sum(axis=1), weights=at.counts) - axes.variance.mean())
    rad2 = 0.0
    if axes.concentration.any():
        cosine = (problem.tree.normals[at.found.rows] @ rotation * axes.normal).sum(axis=1)
        rad2 = float(np.average(1 - cosine, weights=at.counts) - (1 / axes.concentration).mean())
    mm2, rad2 = min(mm2, shrink * before.mm2), min(rad2, shrink * before.rad2)
    return Misalignment(mm2 if mm2 > _NEGLIGIBLE.mm2 else 0.0, rad2 if rad2 > _NEGLIGIBLE.rad2 else 0.0)
