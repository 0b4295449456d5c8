"""Damped Gauss–Newton on pose, scale, smooth error and shape together, from one start."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from naris.core.pose import Pose
from naris.register.deformable.posterior import Linear, Problem, State, linearised
from naris.register.equations import POSE

_WIDTHS = (4.0, 2.0)
"""Far from the truth walls that are only bent must not count as outliers: the noise is said wider at first."""
_FIRST_STEPS = 5
_LONGEST_MM, _LONGEST_RAD, _MOST_SCALE, _MOST_WEIGHT = 2.0, 0.3, 0.3, 1.0
_DAMPING, _LEAST_DAMPING, _MOST_DAMPING = 1e-2, 1e-5, 1e4
_LOOSER, _TIGHTER = 0.3, 6.0
_STILL, _STILL_MM, _STILL_RAD, _STILL_WEIGHT = 1e-4, 0.02, 0.002, 0.02
_ROUNDS = 2  # of fitting the smooth error before the first step


@dataclass(frozen=True, eq=False)
class Ended:
    """Where a start led.

    Attributes:
        state: there.
        at: cost and equations there.
        steps: how many were tried.
        converged: whether it came to rest.
    """

    state: State
    at: Linear
    steps: int
    converged: bool

    @property
    def evidence(self) -> float:
        """−2 log of the share of the posterior that this basin holds, by Laplace's approximation, but for constants."""
        if not np.isfinite(self.at.cost):
            return np.inf
        return self.at.cost + float(np.linalg.slogdet(self.at.matrix + 1e-9 * np.eye(len(self.at.matrix)))[1])


def descended(problem: Problem, begun: State, most_steps: int) -> Ended:
    """The most likely state near one; `most_steps` at the noise that was said, a few before at wider noise.

    A step is taken only if the cost falls, as in rigid registration.
    """
    state, steps, converged = _with_smooth(problem, begun), 0, False
    at = linearised(problem, state, _WIDTHS[0])
    for width, most in (*((width, _FIRST_STEPS) for width in _WIDTHS), (1.0, most_steps)):
        damping, at, converged = _DAMPING, linearised(problem, state, width), False
        for _ in range(most):
            step = _step(at, damping, problem)
            there = _moved(problem, state, step)
            after = linearised(problem, there, width)
            steps += 1
            if after.cost < at.cost:
                gain, state, at = at.cost - after.cost, there, after
                damping = max(damping * _LOOSER, _LEAST_DAMPING)
                if gain < _STILL * len(problem.rays.x) and _is_short(step, problem.first_weight):
                    converged = True
                    break
            else:
                damping *= _TIGHTER
                if damping > _MOST_DAMPING:
                    converged = bool(np.isfinite(at.cost))
                    break
    return Ended(state, at, steps, converged)


def _with_smooth(problem: Problem, state: State) -> State:
    """The smooth error that suits a state, pose and shape kept: else the first step blames them for it."""
    if not problem.model.smooth:
        return state
    part = slice(POSE + problem.model.free, problem.first_weight)
    for _ in range(_ROUNDS):
        at = linearised(problem, state)
        if not np.isfinite(at.cost):
            return state
        state = replace(state, smooth=state.smooth + np.linalg.solve(at.matrix[part, part], at.right[part]))
    return state


def _step(at: Linear, damping: float, problem: Problem) -> Float[np.ndarray, "u"]:
    """A damped step, no longer than the basin."""
    damped = at.matrix + np.diag(damping * np.diag(at.matrix) + 1e-9)
    step = np.linalg.solve(damped, at.right)
    weights = np.abs(step[problem.first_weight :]).max(initial=1e-9)
    lengths = np.linalg.norm(step[:3]), np.linalg.norm(step[3:6]), weights
    longest = (_LONGEST_MM, _LONGEST_RAD, _MOST_WEIGHT)
    shorter = min(1.0, *(most / max(length, 1e-9) for most, length in zip(longest, lengths, strict=True)))
    return np.asarray(shorter * step)


def _moved(problem: Problem, state: State, step: Float[np.ndarray, "u"]) -> State:
    free, first = problem.model.free, problem.first_weight
    log_scale = state.log_scale + (float(np.clip(step[POSE], -_MOST_SCALE, _MOST_SCALE)) if free else 0.0)
    pose = state.pose @ Pose.exp(step[:POSE], "", "").matrix
    return State(pose, log_scale, state.smooth + step[POSE + free : first], state.weights + step[first:])


def _is_short(step: Float[np.ndarray, "u"], first_weight: int) -> bool:
    return bool(
        np.linalg.norm(step[:3]) < _STILL_MM
        and np.linalg.norm(step[3:6]) < _STILL_RAD
        and np.abs(step[first_weight:]).max(initial=0.0) < _STILL_WEIGHT
    )
