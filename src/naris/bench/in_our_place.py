"""Other solvers in the place of ours: the search finds the starts, they end them, our likelihood chooses.

Our search gives everybody the same poses to begin from; what everybody makes of them is judged by our likelihood, and
the best is taken. Libraries and our own coarse and fine solver begin from its 40 best starts, or from fewer where fewer
are asked for; ICP and IMLP, as a user chooses them (`RegisterConfig.method`), from the finalists that our coarse solver
leaves of all. Nobody begins again beside the best. A library has no likelihood, so what it takes ours to choose among
its answers is told apart from what it cost to find them.

None of the libraries estimates a scale with a pose. Where it is unknown, each start keeps the one that the search found
for it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from naris.core.anatomy import Anatomy
from naris.core.pose import CAMERA, Pose
from naris.register.libraries import LIBRARIES, OfCloud, library_for, missing
from naris.register.map import RegistrationMap
from naris.register.observation import Observation
from naris.register.register import RegisterConfig, register
from naris.register.solve import coarse, fine, judged, promising
from naris.register.starts import Belief, Starts, find_starts

OURS = "naris"
METHODS = ("icp", "imlp")
"""Ours as well; of a known scale only."""
SOLVERS = (OURS, *METHODS, *LIBRARIES)
STARTS = 40


@dataclass(frozen=True, eq=False)
class Answer:
    """What a solver came to; nobody refuses here.

    Attributes:
        pose: the most likely `anatomy_T_camera`.
        judging_s: of the CPU seconds, those that our likelihood took to choose it among a library's; 0 for solvers of
            ours, to which choosing among the few that they finish belongs.
    """

    pose: Pose
    judging_s: float = 0.0


Solver = Callable[[RegistrationMap, Observation, Belief], Answer]
"""From what was seen and what is believed."""


def solver_of(name: str, anatomy: Anatomy, seed: int = 0, config: RegisterConfig = RegisterConfig()) -> Solver | str:
    """One of `SOLVERS` made ready for an anatomy; or why it cannot be.

    Args:
        name: of the solver.
        anatomy: what is registered to.
        seed: of the starts beside believed poses.
        config: how much is tried: starts, for all but ICP and IMLP 40 at most, and finalists.
    """
    starts = min(config.starts, STARTS)
    if name == OURS:
        return lambda at, seen, belief: _by_us(at, seen, belief, replace(config, starts=starts, seed=seed))
    if name in METHODS:
        method: Literal["icp", "imlp"] = "icp" if name == "icp" else "imlp"
        by_points = replace(config, method=method, seed=seed, aside=0)
        return lambda at, seen, belief: Answer(register(at, seen, belief, by_points).best)
    if (absent := missing(name)) is not None:
        return absent
    of_cloud = library_for(name, anatomy)
    return lambda at, seen, belief: _by_library(
        of_cloud, at, seen, find_starts(at, seen, belief, starts, np.random.default_rng(seed))
    )


def _by_us(at: RegistrationMap, seen: Observation, belief: Belief, config: RegisterConfig) -> Answer:
    rough = coarse(at, seen, find_starts(at, seen, belief, config.starts, np.random.default_rng(config.seed)))
    best = fine(at, seen, promising(rough, config.finalists)).poses[0]
    return Answer(Pose(best, at.anatomy.frame, CAMERA))


def _by_library(of_cloud: OfCloud, at: RegistrationMap, seen: Observation, starts: Starts) -> Answer:
    points, ended = seen.origins + seen.ranges[:, None] * seen.directions, []
    # Everything is prepared once for a scale: all starts share it where it is known.
    aligned = {scale: of_cloud(np.exp(scale) * points) for scale in set(starts.log_scales.tolist())}
    for pose, scale in zip(starts.poses, starts.log_scales.tolist(), strict=True):
        ended.append(aligned[scale](pose))
    begun = time.process_time()
    best = judged(at, seen, replace(starts, poses=np.stack(ended))).poses[0]
    return Answer(Pose(best, at.anatomy.frame, CAMERA), time.process_time() - begun)
