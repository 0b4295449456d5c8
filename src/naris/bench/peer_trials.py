"""Other solvers in the place of ours: the frozen trials of points (noise d), from the true region's starts."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from naris.bench import BenchRequest
from naris.bench.in_our_place import SOLVERS, Solver, solver_of
from naris.bench.result import Figure, wilson
from naris.bench.trials import Trial, frozen_setting, has_frozen
from naris.core.pose import distance
from naris.register.map import RegistrationMap, registration_map
from naris.register.starts import Belief, in_region

BASE = "register.peers"
QUICK_TRIALS = 3
_RIGHT_MM, _RIGHT_RAD = 2.0, np.deg2rad(5.0)


class _Solved(NamedTuple):
    right: bool
    cpu_s: float


def figures(request: BenchRequest) -> list[Figure]:
    """Success and CPU seconds of each; without values where the trials are not given or a peer is not installed.

    A quick benchmark leaves them out unless they are what it is for.
    """
    left_out = request.quick and request.only is None
    if left_out or request.scans is None or not has_frozen(request.scans):
        return [figure for name in SOLVERS for figure in _of(name, [], {})]
    mean, trials = frozen_setting(request.scans)
    trials = trials[:QUICK_TRIALS] if request.quick else trials
    at, done = registration_map(mean), []
    for name in SOLVERS:
        ready = solver_of(name, mean, request.seed)
        if isinstance(ready, str):
            done += _of(name, [], {name: ready})
            continue
        done += _of(name, _run(request, name, at, trials, ready), {})
    return done


def _of(name: str, solved: Sequence[_Solved], peers: Mapping[str, str]) -> list[Figure]:
    n, base = len(solved), f"{BASE}.{name.lower()}.d"
    if not n:
        return [
            Figure(f"{base}.success", None, "1", 0, "higher", peers=dict(peers)),
            Figure(f"{base}.cpu_s", None, "CPU-s", 0, "lower", peers=dict(peers)),
        ]
    right = sum(one.right for one in solved)
    spent = float(np.mean([one.cpu_s for one in solved]))
    return [
        Figure(f"{base}.success", right / n, "1", n, "higher", None, wilson(right, n)),
        Figure(f"{base}.cpu_s", spent, "CPU-s", n, "lower"),
    ]


def _run(
    request: BenchRequest, name: str, at: RegistrationMap, trials: Sequence[Trial], solver: Solver
) -> list[_Solved]:
    regions, solved = at.anatomy.region_set(), []
    solver(at, trials[0].observation("d"), Belief())  # compiles what there is to compile
    with request.progress.task(f"{name} on points", len(trials)) as advance:
        for trial in trials:
            truth = trial.anatomy_T_camera
            belief = in_region(regions, regions.names[int(regions.label(truth.position_mm))])
            begun = time.process_time()
            found = solver(at, trial.observation("d"), belief)
            spent = time.process_time() - begun
            off_mm, off_rad = distance(found, truth)
            solved.append(_Solved(bool(off_mm <= _RIGHT_MM and off_rad <= _RIGHT_RAD), spent))
            advance(1)
    return solved
