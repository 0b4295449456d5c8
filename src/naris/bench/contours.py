"""What a frame adds to a registration, by its edges or its shading: the error before and after.

Views of virtual patients as those of `naris.bench.trials`. Edges (`naris.register.contour`) are sought in the picture
that our renderer makes of them as it is; shading (`naris.register.shading`) is compared with pictures of other mucosa
and light, as no training had them. Counted are poses near the truth, for neither brings one from another place.
"""

from __future__ import annotations

import time

import numpy as np
from jaxtyping import UInt8

from naris.anatomy.builtin.variation import virtual_patient
from naris.bench import BenchRequest
from naris.bench.result import Figure
from naris.bench.trials import CAMERA_OF_TRIALS, FRAME_PX, Noise, Trial, drawn_trials, frames
from naris.core.camera import Intrinsics
from naris.core.pose import Pose, distance
from naris.core.results import Registration
from naris.evaluate.score import normalised_square
from naris.register.contour import FEWEST_EDGES, sharpened
from naris.register.map import registration_map
from naris.register.register import RegisterConfig, register
from naris.register.shading import reshaded
from naris.render.scene import Scene, render

PATIENTS, VIEWS, QUICK_PATIENTS, QUICK_VIEWS = 8, 6, 1, 2
NOISES: tuple[Noise, ...] = ("b", "d")
METHODS = {"contours": "with_edges", "shading": "used"}
"""And what the share of frames is called that could be used."""

EYE = Intrinsics.from_vertical_fov(320, 320, CAMERA_OF_TRIALS.vertical_fov_deg)
_SEEDS = 6_000_000  # of the patients, apart from those of the other benchmarks
_NEAR_MM, _NEAR_DEG = 4.0, 10.0


def figures(request: BenchRequest) -> list[Figure]:
    """By what is used and noise: the mean error before and after where it is, and how many of all near poses are close.

    And the squared error of right ones over what their covariances say, as `naris.bench.register.of_covariance`.
    """
    count, views = (QUICK_PATIENTS, QUICK_VIEWS) if request.quick else (PATIENTS, VIEWS)
    rows: dict[str, list[tuple[float, ...]]] = {f"{name}.{noise}": [] for name in METHODS for noise in NOISES}
    with request.progress.task("contours", count) as advance:
        for number in range(count):
            nose = virtual_patient(_SEEDS + request.seed, number)
            at, scene = registration_map(nose), Scene(nose)
            trials = drawn_trials(nose, views, _SEEDS + request.seed + number)
            others = frames(nose, trials, _SEEDS + request.seed + number)
            for view, (trial, other) in enumerate(zip(trials, others, strict=True)):
                frame = render(scene, trial.anatomy_T_camera.reshape(-1), EYE, want=("rgb",)).rgb
                if frame is None:
                    continue
                for noise in NOISES:
                    found = register(at, trial.observation(noise), config=RegisterConfig(seed=view))
                    if _near(found, trial):
                        rows[f"contours.{noise}"].append(_by_edges(scene, found, trial, frame[0]))
                        rows[f"shading.{noise}"].append(_by_shading(scene, found, trial, other))
            advance(1)
    return [figure for name, some in rows.items() for figure in _of(name, np.array(some).reshape(-1, 8))]


def _near(found: Registration, trial: Trial) -> bool:
    off_mm, off_deg = _off(found.best, trial.anatomy_T_camera)
    return off_mm <= _NEAR_MM and off_deg <= _NEAR_DEG


def _by_edges(scene: Scene, found: Registration, trial: Trial, frame: UInt8[np.ndarray, "h w 3"]) -> tuple[float, ...]:
    begun = time.process_time()
    made = sharpened(scene, found, frame, EYE)
    spent = time.process_time() - begun
    return _row(found, made.registration, trial, made.edges >= FEWEST_EDGES, spent)


def _by_shading(
    scene: Scene, found: Registration, trial: Trial, frame: UInt8[np.ndarray, "h w 3"]
) -> tuple[float, ...]:
    begun = time.process_time()
    made = reshaded(scene, found, frame, CAMERA_OF_TRIALS.resized(FRAME_PX, FRAME_PX))
    return _row(found, made.registration, trial, made.used, time.process_time() - begun)


def _row(found: Registration, made: Registration, trial: Trial, used: bool, spent: float) -> tuple[float, ...]:
    truth = trial.anatomy_T_camera
    squares = [normalised_square(one.best, truth, one.covariance) for one in (found, made)]
    return (*_off(found.best, truth), *_off(made.best, truth), float(used), spent, *squares)


def _off(pose: Pose, truth: Pose) -> tuple[float, float]:
    off_mm, off_rad = distance(pose, truth)
    return float(off_mm), float(np.rad2deg(off_rad))


def _of(name: str, rows: np.ndarray) -> list[Figure]:
    base, edged = f"register.{name}", rows[rows[:, 4] > 0]
    made = [
        Figure(
            f"{base}.{METHODS[name.split('.')[0]]}",
            float(rows[:, 4].mean()) if len(rows) else 0.0,
            "1",
            len(rows),
            "higher",
        )
    ]
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
