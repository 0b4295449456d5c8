# ruff: noqa: ANN001, ANN201, ANN202
# mypy: ignore-errors
"""Damped Gauss–Newton on the equations of a registration, compiled."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from naris.register.cloud_equations import Cloud, linearise_cloud
from naris.register.equations import CLOUD, MOST_UNKNOWNS, POSE, Equations, Memory, Model, Rays, linearise_rays
from naris.render.packets import Embree

_LONGEST_MM, _LONGEST_RAD = 2.0, 0.3
_MOST_SCALE = 0.3
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-2, 1e-5, 1e4
_STILL, _STILL_MM, _STILL_RAD = 1e-4, 0.02, 0.002
_STILL_FIT, _DEAREST = 1e-5, 1e30  # −2 log likelihood a ray

_njit = njit(cache=True, nogil=True, fastmath=True, error_model="numpy", boundscheck=False)
_part_njit = njit(nogil=True, fastmath=True, error_model="numpy", boundscheck=False)


class Sight(NamedTuple):
    """What was seen, in what, and the working memory of one thread.

    Attributes:
        embree: the anatomy's scene.
        cloud: points, where they are compared with all that is seen around them; its rays are then the lattices'.
        sources: an array whose type changes with the sources of this code: numba looks at one file only.
    """

    embree: Embree
    rays: Rays
    model: Model
    memory: Memory
    cloud: Cloud
    sources: np.ndarray


class States(NamedTuple):
    """Poses (N, 4, 4), logarithms of scales (N,), coefficients of the smooth error (N, 64) and costs (N,)."""

    poses: np.ndarray
    log_scales: np.ndarray
    smooth: np.ndarray
    costs: np.ndarray


class Schedule(NamedTuple):
    """How long is solved.

    Attributes:
        widths: of the noise, by stage.
        steps: the most of them, by stage.
        rounds: the most of fitting the smooth error before the first step.
    """

    widths: np.ndarray
    steps: np.ndarray
    rounds: int


@_part_njit
def linearise(sight, pose, log_scale, smooth, width, equations):
    """The normal equations at a pose, and its cost: −2 log likelihood (and prior) a ray or point."""
    if sight.model.kind == CLOUD:
        return linearise_cloud(sight, pose, log_scale, smooth, width, equations)
    return linearise_rays(sight, pose, log_scale, smooth, width, equations)


@_part_njit
def _empty():
    return Equations(np.empty((MOST_UNKNOWNS, MOST_UNKNOWNS)), np.empty(MOST_UNKNOWNS))


@_part_njit
def _solve(matrix, right, n):
    """Solves the normal equations in place, by Cholesky; `right` becomes the solution."""
    for i in range(n):
        for j in range(i + 1):
            q = matrix[i, j]
            for k in range(j):
                q -= matrix[i, k] * matrix[j, k]
            if i == j:
                matrix[i, i] = np.sqrt(max(q, 1e-12))
            else:
                matrix[i, j] = q / matrix[j, j]
    for i in range(n):
        q = right[i]
        for k in range(i):
            q -= matrix[i, k] * right[k]
        right[i] = q / matrix[i, i]
    for i in range(n - 1, -1, -1):
        q = right[i]
        for k in range(i + 1, n):
            q -= matrix[k, i] * right[k]
        right[i] = q / matrix[i, i]


@_part_njit
def _move(pose, step):
    """Applies a twist from the right: the translation in the rig, then Rodrigues' rotation."""
    wx, wy, wz = step[3], step[4], step[5]
    angle2 = wx * wx + wy * wy + wz * wz
    if angle2 < 1e-18:
        a, b = 1.0, 0.5
    else:
        angle = np.sqrt(angle2)
        a, b = np.sin(angle) / angle, (1 - np.cos(angle)) / angle2
    turn = np.empty((3, 3))
    turn[0, 0], turn[0, 1], turn[0, 2] = 1 - b * (wy * wy + wz * wz), b * wx * wy - a * wz, b * wx * wz + a * wy
    turn[1, 0], turn[1, 1], turn[1, 2] = b * wx * wy + a * wz, 1 - b * (wx * wx + wz * wz), b * wy * wz - a * wx
    turn[2, 0], turn[2, 1], turn[2, 2] = b * wx * wz - a * wy, b * wy * wz + a * wx, 1 - b * (wx * wx + wy * wy)
    for i in range(3):
        x, y, z = pose[i, 0], pose[i, 1], pose[i, 2]
        pose[i, 3] += x * step[0] + y * step[1] + z * step[2]
        for j in range(3):
            pose[i, j] = x * turn[0, j] + y * turn[1, j] + z * turn[2, j]


@_part_njit
def _fit_smooth(sight, pose, log_scale, smooth, rounds, equations):
    """The smooth error that suits a pose, the pose kept: else the first step blames the pose for it.

    Each round is one of expectation and maximisation (Dempster, Laird and Rubin 1977): the cost never rises.
    """
    first, n = POSE + sight.model.free, sight.model.smooth
    part, change = np.empty((n, n)), np.empty(n)
    before = _DEAREST
    for _ in range(rounds):
        cost = linearise(sight, pose, log_scale, smooth, 1.0, equations)
        if before - cost < _STILL_FIT:
            break
        before = cost
        for i in range(n):
            for j in range(i + 1):
                part[i, j] = equations.matrix[first + i, first + j]
            change[i] = equations.right[first + i]
        _solve(part, change, n)
        for i in range(n):
            smooth[i] += change[i]


@_njit
def solve(sight, states, schedule, first, last):
    """Levenberg–Marquardt from poses[first] … poses[last − 1], which become where it ends.

    A step is taken only if the cost falls, for the equations of a grazing wall promise more than they keep. Stage k
    of the schedule takes at most steps[k] trials at the width widths[k].
    """
    model, smooth = sight.model, states.smooth
    here, beyond, damped = _empty(), _empty(), _empty()
    there, smooth_there = np.empty((4, 4)), np.empty(MOST_UNKNOWNS)
    step, n = damped.right, POSE + model.free + model.smooth
    for i in range(first, last):
        pose, log_scale, damping, cost = states.poses[i], states.log_scales[i], _DAMPING, 0.0
        if model.smooth:
            _fit_smooth(sight, pose, log_scale, smooth[i], schedule.rounds, here)
        for stage in range(len(schedule.widths)):
            width = schedule.widths[stage]
            cost = linearise(sight, pose, log_scale, smooth[i], width, here)
            for _ in range(schedule.steps[stage]):
                moved_mm, moved_rad = _step(here, damping, n, damped)
                there[:] = pose
                _move(there, step)
                scale_there = log_scale
                if model.free:
                    scale_there += min(max(step[POSE], -_MOST_SCALE), _MOST_SCALE)
                for k in range(model.smooth):
                    smooth_there[k] = smooth[i, k] + step[POSE + model.free + k]
                cost_there = linearise(sight, there, scale_there, smooth_there, width, beyond)
                if cost_there < cost:
                    gain, cost, log_scale = cost - cost_there, cost_there, scale_there
                    pose[:] = there
                    for k in range(model.smooth):
                        smooth[i, k] = smooth_there[k]
                    here.matrix[:n, :n], here.right[:n] = beyond.matrix[:n, :n], beyond.right[:n]
                    damping = max(damping * 0.3, _LEAST_DAMPING)
                    if gain < _STILL and moved_mm < _STILL_MM and moved_rad < _STILL_RAD:
                        break
                else:
                    damping *= 6.0
                    if damping > _MOST_DAMPING:
                        break
            damping = max(min(damping, 1.0), 1e-3)
        states.log_scales[i], states.costs[i] = log_scale, cost


@_part_njit
def _step(here, damping, n, damped):
    """A damped step, no longer than the basin, left in `damped.right`; gives the lengths of its two parts."""
    matrix, step = here.matrix, damped.right
    for i in range(n):
        for j in range(i + 1):
            damped.matrix[i, j] = matrix[i, j]
        damped.matrix[i, i] = matrix[i, i] * (1 + damping) + 1e-9
        step[i] = here.right[i]
    _solve(damped.matrix, step, n)
    moved_mm = np.sqrt(step[0] ** 2 + step[1] ** 2 + step[2] ** 2)
    moved_rad = np.sqrt(step[3] ** 2 + step[4] ** 2 + step[5] ** 2)
    shorter = min(1.0, _LONGEST_MM / max(moved_mm, 1e-9), _LONGEST_RAD / max(moved_rad, 1e-9))
    for i in range(n):
        step[i] *= shorter
    return moved_mm, moved_rad


@_njit
def judge(sight, states, first, last, matrices):
    """The cost of states first … last − 1 as they are, and the whole matrices of their normal equations."""
    here, n = _empty(), POSE + sight.model.free + sight.model.smooth
    for i in range(first, last):
        states.costs[i] = linearise(sight, states.poses[i], states.log_scales[i], states.smooth[i], 1.0, here)
        for a in range(n):
            for b in range(a + 1):
                matrices[i, a, b] = here.matrix[a, b]
                matrices[i, b, a] = here.matrix[a, b]
