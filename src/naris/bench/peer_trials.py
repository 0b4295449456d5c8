"""Other solvers in the place of ours on the frozen trials: from the true region, nothing and a pose, and three views.

Success and CPU seconds stand beside those of the whole registration (`register.region.b.success` and the like). What
our likelihood took to choose among the answers of a library, which has none, stands apart from what they cost.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from functools import cache
from typing import NamedTuple

import numpy as np

from naris.bench import BenchRequest
from naris.bench.in_our_place import METHODS, SOLVERS, Solver, solver_of
from naris.bench.problems import SOLVED_POINTS, Start, near_truth, problem
from naris.bench.result import Figure, wilson
from naris.bench.trials import Noise, Trial, frozen_setting, has_frozen
from naris.core.pose import distance
from naris.register.libraries import LIBRARIES, OfCloud, library_for, missing
from naris.register.map import RegistrationMap, registration_map
from naris.register.register import FROM_POSE, RegisterConfig
from naris.register.starts import Belief

BASE = "register.peers"
ASKED: tuple[tuple[Start, Noise], ...] = (
    ("region", "b"),
    ("region", "c"),
    ("region", "d"),
    ("none", "b"),
    ("none", "c"),
    ("none", "d"),
    ("pose", "b"),
    ("views3", "b"),
    ("views3", "c"),
)
"""What has a goal and noise: without noise everybody is right."""
QUICK_TRIALS = 3
NO_SCALE = "solves for a known scale only"
_SOLVES = 40
_RIGHT_MM, _RIGHT_RAD = 2.0, np.deg2rad(5.0)


class _Solved(NamedTuple):
    right: bool
    cpu_s: float
    judging_s: float


def figures(request: BenchRequest) -> list[Figure]:
    """Success and CPU seconds of each; without values where the trials are not given or a peer is not installed.

    A quick benchmark leaves them out unless they are what it is for.
    """
    left_out = request.quick and request.only is None
    if left_out or request.scans is None or not has_frozen(request.scans):
        nothing = [figure for asked in ASKED for name in SOLVERS for figure in _of(name, asked, [], {})]
        return [*nothing, *(_solve_figure(name, None) for name in LIBRARIES)]
    mean, trials = frozen_setting(request.scans)
    trials = trials[:QUICK_TRIALS] if request.quick else trials
    at, done = registration_map(mean), []

    @cache
    def ready(name: str, config: RegisterConfig) -> Solver | str:
        return solver_of(name, mean, request.seed, config)

    for start, noise in ASKED:
        config = FROM_POSE if start == "pose" else RegisterConfig()
        for name in SOLVERS:
            solver = NO_SCALE if name in METHODS and noise == "c" else ready(name, config)
            if isinstance(solver, str):
                done += _of(name, (start, noise), [], {name: solver})
            else:
                done += _of(name, (start, noise), _run(request, name, (start, noise), at, trials, solver), {})
    solves = (_solve_figure(name, missing(name) or library_for(name, mean), trials[0]) for name in LIBRARIES)
    return [*done, *solves]


def _solve_figure(name: str, ready: OfCloud | str | None, trial: Trial | None = None) -> Figure:
    """One solve of as many points as `register.solve.cpu_ms`, from poses beside the truth, as that is measured."""
    called = f"{BASE}.{name.lower()}.solve.cpu_ms"
    if ready is None or isinstance(ready, str) or trial is None:
        return Figure(called, None, "ms", 0, "lower", peers={} if ready is None else {name: str(ready)})
    seen = trial.observation("b").some(SOLVED_POINTS)
    align = ready(seen.origins + seen.ranges[:, None] * seen.directions)
    rng = np.random.default_rng(7)
    starts = [near_truth(trial, rng).matrix for _ in range(_SOLVES)]
    align(starts[0])
    begun = time.process_time()
    for start in starts:
        align(start)
    return Figure(called, 1e3 * (time.process_time() - begun) / len(starts), "ms", len(starts), "lower")


def _of(name: str, asked: tuple[Start, Noise], solved: Sequence[_Solved], peers: Mapping[str, str]) -> list[Figure]:
    n, base = len(solved), ".".join((BASE, name.lower(), *asked))
    if not n:
        return [
            Figure(f"{base}.success", None, "1", 0, "higher", peers=dict(peers)),
            Figure(f"{base}.cpu_s", None, "CPU-s", 0, "lower", peers=dict(peers)),
        ]
    right = sum(one.right for one in solved)
    spent, judging = (float(np.mean(each)) for each in zip(*(one[1:] for one in solved), strict=True))
    made = [
        Figure(f"{base}.success", right / n, "1", n, "higher", None, wilson(right, n)),
        Figure(f"{base}.cpu_s", spent, "CPU-s", n, "lower"),
    ]
    if name in LIBRARIES:
        made.append(Figure(f"{base}.judging_cpu_s", judging, "CPU-s", n, "lower"))
    return made


def _run(
    request: BenchRequest,
    name: str,
    asked: tuple[Start, Noise],
    at: RegistrationMap,
    trials: Sequence[Trial],
    solver: Solver,
) -> list[_Solved]:
    solved, (start, noise) = [], asked
    solver(at, trials[0].observation(noise), Belief())  # compiles what there is to compile
    with request.progress.task(f"{name}, {start} {noise}", len(trials)) as advance:
        for number, trial in enumerate(trials):
            look, belief, _ = problem(at, trial, noise, start, request.seed + number)
            begun = time.process_time()
            found = solver(at, look(), belief)
            spent = time.process_time() - begun - found.judging_s
            off_mm, off_rad = distance(found.pose, trial.anatomy_T_camera)
            solved.append(_Solved(bool(off_mm <= _RIGHT_MM and off_rad <= _RIGHT_RAD), spent, found.judging_s))
            advance(1)
    return solved
