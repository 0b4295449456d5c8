"""What the edges of a frame add to a registration: its error before and after (`naris.register.contour`).

Views of virtual patients as those of `naris.bench.trials`, with the picture that our renderer makes of them. Counted
are those that were registered near the truth, for no edge brings a pose from another place.
"""

from __future__ import annotations

import time

import numpy as np

from naris.anatomy.builtin.variation import virtual_patient
from naris.bench import BenchRequest
from naris.bench.result import Figure
from naris.bench.trials import CAMERA_OF_TRIALS, Noise, drawn_trials
from naris.core.camera import Intrinsics
from naris.core.pose import Pose, distance
from naris.evaluate.score import normalised_square
from naris.register.contour import FEWEST_EDGES, sharpened
from naris.register.map import registration_map
from naris.register.register import RegisterConfig, register
from naris.render.scene import Scene, render

PATIENTS, VIEWS, QUICK_PATIENTS, QUICK_VIEWS = 8, 6, 1, 2
NOISES: tuple[Noise, ...] = ("b", "d")
EYE = Intrinsics.from_vertical_fov(320, 320, CAMERA_OF_TRIALS.vertical_fov_deg)
_SEEDS = 6_000_000  # of the patients, apart from those of the other benchmarks
_NEAR_MM, _NEAR_DEG = 4.0, 10.0


def figures(request: BenchRequest) -> list[Figure]:
    """By noise: the mean error before and after where there are edges, and how many of all near poses are close.

    And the squared error of right ones over what their covariances say, as `naris.bench.register.of_covariance`.
    """
    count, views = (QUICK_PATIENTS, QUICK_VIEWS) if request.quick else (PATIENTS, VIEWS)
    rows: dict[Noise, list[tuple[float, ...]]] = {noise: [] for noise in NOISES}
    with request.progress.task("contours", count) as advance:
        for number in range(count):
            nose = virtual_patient(_SEEDS + request.seed, number)
            at, scene = registration_map(nose), Scene(nose)
            for view, trial in enumerate(drawn_trials(nose, views, _SEEDS + request.seed + number)):
                truth = trial.anatomy_T_camera
                frame = render(scene, truth.reshape(-1), EYE, want=("rgb",)).rgb
                if frame is None:
                    continue
                for noise in NOISES:
                    found = register(at, trial.observation(noise), config=RegisterConfig(seed=view))
                    begun = time.process_time()
                    made = sharpened(scene, found, frame[0], EYE)
                    spent = time.process_time() - begun
                    before, after = _off(found.best, truth), _off(made.registration.best, truth)
                    if before[0] <= _NEAR_MM and before[1] <= _NEAR_DEG:
                        squares = [
                            normalised_square(one.best, truth, one.covariance) for one in (found, made.registration)
                        ]
                        rows[noise].append((*before, *after, float(made.edges >= FEWEST_EDGES), spent, *squares))
            advance(1)
    return [figure for noise in NOISES for figure in _of(noise, np.array(rows[noise]).reshape(-1, 8))]


def _off(pose: Pose, truth: Pose) -> tuple[float, float]:
    off_mm, off_rad = distance(pose, truth)
    return float(off_mm), float(np.rad2deg(off_rad))


def _of(noise: Noise, rows: np.ndarray) -> list[Figure]:
    base, edged = f"register.contours.{noise}", rows[rows[:, 4] > 0]
    made = [Figure(f"{base}.with_edges", float(rows[:, 4].mean()) if len(rows) else 0.0, "1", len(rows), "higher")]
    for first, square, when in ((0, 6, "before"), (2, 7, "after")):
        off_mm, off_deg = (edged[:, first], edged[:, first + 1]) if len(edged) else (np.full(1, np.nan),) * 2
        close = (rows[:, first] <= 1.0) & (rows[:, first + 1] <= 3.0)
        n = len(edged)
        made += [
            Figure(f"{base}.{when}_mm", float(off_mm.mean()) if n else 0.0, "mm", n, "lower"),
            Figure(f"{base}.{when}_deg", float(off_deg.mean()) if n else 0.0, "deg", n, "lower"),
            Figure(f"{base}.{when}_close", float(close.mean()) if len(rows) else 0.0, "1", len(rows), "higher"),
            _normalised(f"{base}.{when}_normalised", edged[:, [first, first + 1, square]]),
        ]
    return [*made, Figure(f"{base}.cpu_s", float(rows[:, 5].mean()) if len(rows) else 0.0, "CPU-s", len(rows), "lower")]


def _normalised(name: str, rows: np.ndarray) -> Figure:
    """Of rows (N, 3) of mm, degrees and squares."""
    squares = rows[(rows[:, 0] <= 2.0) & (rows[:, 1] <= 5.0), 2]
    return Figure(name, float(squares.mean()) if len(squares) else None, "1", len(squares), "lower")
