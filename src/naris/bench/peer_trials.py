"""Other solvers in the place of ours: the frozen trials of points (noise d), from the true region's starts.

Our search gives everybody the same poses to begin from; what everybody makes of them is judged by our likelihood, and
the best is taken. Peers and our own coarse and fine solver begin from its 40 best starts; ICP and IMLP, as a user
chooses them (`RegisterConfig.method`), from the eight finalists that our coarse solver leaves of 200.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Literal, NamedTuple

import numpy as np

from naris.bench import BenchRequest
from naris.bench.point_peers import PEERS, Align, aligner, target_of
from naris.bench.result import Figure, wilson
from naris.bench.trials import Trial, frozen_setting, has_frozen
from naris.core.pose import CAMERA, Pose, distance
from naris.register.map import RegistrationMap, registration_map
from naris.register.observation import Observation
from naris.register.register import RegisterConfig, register
from naris.register.solve import coarse, different, fine, judged
from naris.register.starts import Belief, Starts, find_starts, in_region

BASE = "register.peers"
OURS, CHOSEN = "naris", ("icp", "imlp")
QUICK_TRIALS = 3
_STARTS, _FINALISTS = 40, 8
_TARGET_POINTS = 100_000
_REACHES_MM = (5.0, 2.5)
_RIGHT_MM, _RIGHT_RAD = 2.0, np.deg2rad(5.0)

Solver = Callable[[RegistrationMap, Observation, Belief], Pose]


class _Solved(NamedTuple):
    right: bool
    cpu_s: float


def figures(request: BenchRequest) -> list[Figure]:
    """Success and CPU seconds of each; without values where the trials are not given or a peer is not installed.

    A quick benchmark leaves them out unless they are what it is for.
    """
    left_out = request.quick and request.only is None
    if left_out or request.scans is None or not has_frozen(request.scans):
        return [figure for name in (OURS, *CHOSEN, *PEERS) for figure in _of(name, [], {})]
    mean, trials = frozen_setting(request.scans)
    trials = trials[:QUICK_TRIALS] if request.quick else trials
    at, done = registration_map(mean), []
    target = target_of(mean.vertices_mm, mean.faces, _TARGET_POINTS, np.random.default_rng(request.seed))
    for name in (OURS, *CHOSEN, *PEERS):
        ready = _solver(name, lambda peer: aligner(peer, target, _REACHES_MM))
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


def _solver(name: str, ready_for: Callable[[str], Callable[[np.ndarray], Align] | str]) -> Solver | str:
    if name == OURS:
        return _by_us
    if name in CHOSEN:
        method: Literal["icp", "imlp"] = "icp" if name == "icp" else "imlp"
        config = RegisterConfig(method=method)
        return lambda at, seen, belief: register(at, seen, belief, config).best
    of_cloud = ready_for(name)
    if isinstance(of_cloud, str):
        return of_cloud

    def by_peer(at: RegistrationMap, seen: Observation, belief: Belief) -> Pose:
        align = of_cloud(seen.origins + seen.ranges[:, None] * seen.directions)
        starts = _starts(at, seen, belief)
        ended = np.stack([_proper(align(pose)) for pose in starts.poses])
        return Pose(judged(at, seen, Starts(ended, starts.log_scales)).poses[0], at.anatomy.frame, CAMERA)

    return by_peer


def _by_us(at: RegistrationMap, seen: Observation, belief: Belief) -> Pose:
    rough = coarse(at, seen, _starts(at, seen, belief))
    kept = different(rough, _FINALISTS)
    best = fine(at, seen, Starts(rough.poses[kept], rough.log_scales[kept])).poses[0]
    return Pose(best, at.anatomy.frame, CAMERA)


def _starts(at: RegistrationMap, seen: Observation, belief: Belief) -> Starts:
    return find_starts(at, seen, belief, _STARTS, np.random.default_rng(0))


def _proper(pose: np.ndarray) -> np.ndarray:
    """The nearest rotation: peers return theirs with what rounding left of it."""
    u, _, w = np.linalg.svd(pose[:3, :3])
    cleaned = pose.copy()
    cleaned[:3, :3] = u @ w
    return cleaned
