"""Registration to a mean anatomy whose shape is estimated, beside rigid registration to the same mean.

Patients are drawn around the mean nose, so that it is known which of its vertices is where in each of them: from the
very modes that are estimated (`register.deformable`), from the whole Gaussian process with displacements walked as a
flow (`.full`), and from the modes with twice the deviation that the registration believes in (`.wider`). Views and
noise are those of `naris.bench.trials`. Then the real shot of structure from motion, of which no truth is known.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from naris.anatomy.gaussian_process import GaussianProcess
from naris.anatomy.read import read_surface
from naris.anatomy.shape_curves import MOST_SD
from naris.anatomy.triangles import index_triangles
from naris.bench import BenchRequest
from naris.bench.result import Figure, wilson
from naris.bench.trials import MEAN, Noise, Trial, drawn_trials
from naris.core.anatomy import Anatomy
from naris.core.pose import distance
from naris.register.deformable.modes import Modes, of_gaussian_process
from naris.register.deformable.register import register_deformable
from naris.register.deformable.result import DeformableRegistration
from naris.register.map import RegistrationMap, registration_map
from naris.register.observation import Observation
from naris.register.sfm.read import read_reconstruction
from naris.register.sfm.reconstruction import noise_of, observed, unknown_scale

BASE, SFM = "register.deformable", "register.sinus_sfm"
SHOT, VIEW = "sinus-sfm", "4600"
PATIENTS, VIEWS, QUICK_PATIENTS = 6, 2, 1
SETS: dict[str, tuple[Noise, ...]] = {"": ("b", "c", "d"), ".full": ("b", "d"), ".wider": ("b",)}
HALVINGS, QUICK_HALVINGS = 5, 1
TARGET_MM, TURN_DEG = 2.0, 5.0
"""A registration is right if the walls in view are within so much, vertex by vertex, and turned by no more."""
_WIDER = 2.0
SHOT_FILES = ("motion.yaml", "structure.ply")


@dataclass(frozen=True, eq=False)
class Outcome:
    """One registration beside the truth.

    Attributes:
        surface_mm: mean distance of the walls that were seen, where they truly are, from those that were found.
        target_mm: mean distance of the vertices in view from where they were found, in the camera.
        turn_deg: how far those vertices as a whole are turned.
        off_mm, off_deg: of the pose in the frame of the anatomy; shape and pose share what both can explain.
        off_scale: absolute logarithm of the ratio of the scales.
        score: root mean square of the weights' errors over their deviations; None where the weights are not known.
        registered: whether it was not refused.
    """

    surface_mm: float
    target_mm: float
    turn_deg: float
    off_mm: float
    off_deg: float
    off_scale: float
    score: float | None
    registered: bool

    @property
    def right(self) -> bool:
        return self.target_mm <= TARGET_MM and self.turn_deg <= TURN_DEG


@dataclass(frozen=True, eq=False)
class Patient:
    """A truth: the anatomy, the weights that made it where there are such, and views of it."""

    anatomy: Anatomy
    weights: Float[np.ndarray, "k"] | None
    trials: Sequence[Trial]


def figures(request: BenchRequest) -> list[Figure]:
    """All of them; without values where the mean nose or the shot is not given.

    A quick benchmark leaves them out unless they are what it is for.
    """
    left_out = request.quick and request.only is None
    if left_out or request.scans is None or not (request.scans / MEAN).is_file():
        return [*(figure for name in SETS for figure in _of_set(name, {})), *_of_shot(None, [])]
    mean = read_surface(request.scans / MEAN)
    process = GaussianProcess.around(mean)
    modes, at = of_gaussian_process(process), registration_map(mean)
    made: list[Figure] = []
    for name, noises in SETS.items():
        made += _of_set(name, _run(request, name, (at, modes), (_patients(request, name, process, modes), noises)))
    return made + _shot(request, request.scans / SHOT, at, modes)


def _patients(request: BenchRequest, name: str, process: GaussianProcess, modes: Modes) -> Iterator[Patient]:
    count = QUICK_PATIENTS if request.quick else PATIENTS
    for number in range(count):
        seed, weights = request.seed + number, None
        if name == ".full":
            anatomy = process.patient(request.seed, number)
        else:
            drawn = np.random.default_rng([request.seed, number, 8]).standard_normal(len(modes))
            weights = (_WIDER if name == ".wider" else 1.0) * np.clip(drawn, -MOST_SD, MOST_SD)
            anatomy = modes.mean.with_(vertices_mm=modes.vertices_mm(weights), passages=())
        yield Patient(anatomy, weights, drawn_trials(anatomy, VIEWS, seed))


def _run(
    request: BenchRequest,
    name: str,
    to: tuple[RegistrationMap, Modes],
    of: tuple[Iterator[Patient], tuple[Noise, ...]],
) -> dict[str, list[Outcome]]:
    """The outcomes by noise and `modes` or `rigid`."""
    (at, modes), (patients, noises) = to, of
    count = QUICK_PATIENTS if request.quick else PATIENTS
    done: dict[str, list[Outcome]] = {f"{noise}.{how}": [] for noise in noises for how in ("modes", "rigid")}
    with request.progress.task(f"shapes{name}", count) as advance:
        for patient in patients:
            for trial in patient.trials:
                for noise in noises:
                    for how, used in (("modes", modes), ("rigid", modes.first(0))):
                        found = register_deformable(at, used, trial.observation(noise))
                        done[f"{noise}.{how}"].append(judged(patient, trial, noise, found))
            advance(1)
    return done


def judged(patient: Patient, trial: Trial, noise: Noise, found: DeformableRegistration) -> Outcome:
    """What was found beside the truth."""
    seen = trial.rays.reshape(-1, 3) * trial.ranges["a"].reshape(-1, 1)
    seen = seen[np.isfinite(seen).all(axis=1)]
    truth = trial.anatomy_T_camera.inverse().apply(patient.anatomy.vertices_mm)
    guess = found.best.inverse().apply(found.deformed.vertices_mm)
    surface = index_triangles(guess, found.deformed.faces).closest(seen).distance_mm
    in_view = np.unique(cKDTree(truth).query(seen)[1])
    off_mm, off_rad = distance(found.best, trial.anatomy_T_camera)
    score = None
    if patient.weights is not None and len(found.weights):
        score = float(np.sqrt(np.mean(np.square((found.weights - patient.weights) / found.weight_sd))))
    return Outcome(
        float(surface.mean()),
        float(np.linalg.norm(guess - truth, axis=1)[in_view].mean()),
        _turn_deg(guess[in_view], truth[in_view]),
        float(off_mm),
        float(np.rad2deg(off_rad)),
        abs(float(np.log(found.scale)) - trial.log_scale(noise)),
        score,
        found.status == "registered",
    )


def _turn_deg(one: Float[np.ndarray, "n 3"], other: Float[np.ndarray, "n 3"]) -> float:
    """Of the rotation that lays points on others best."""
    turn, _ = Rotation.align_vectors(other - other.mean(axis=0), one - one.mean(axis=0))
    return float(np.rad2deg(turn.magnitude()))


def _of_set(name: str, done: dict[str, list[Outcome]]) -> list[Figure]:
    made: list[Figure] = []
    for noise in SETS[name]:
        for how in ("modes", "rigid"):
            base, some = f"{BASE}{name}.{noise}.{how}", done.get(f"{noise}.{how}", [])
            n, right = len(some), sum(one.right for one in some)
            share = right / n if n else None
            made += [
                Figure(f"{base}.success", share, "1", n, "higher", None, wilson(right, n) if n else None),
                Figure(f"{base}.target_mm", _median(some, lambda one: one.target_mm), "mm", n, "lower"),
                Figure(f"{base}.surface_mm", _median(some, lambda one: one.surface_mm), "mm", n, "lower"),
                Figure(f"{base}.turn_deg", _median(some, lambda one: one.turn_deg), "°", n, "lower"),
                Figure(f"{base}.pose_mm", _median(some, lambda one: one.off_mm), "mm", n, "lower"),
                Figure(f"{base}.pose_deg", _median(some, lambda one: one.off_deg), "°", n, "lower"),
            ]
            if noise == "c":
                off = _median(some, lambda one: one.off_scale)
                made.append(Figure(f"{base}.scale_off", off, "1", n, "lower"))
    every = [one for key, some in done.items() if key.endswith(".modes") for one in some]
    taken = [one for one in every if one.registered]
    scores = [one.score for one in every if one.right and one.score is not None]
    wrong = sum(not one.right for one in taken)
    return [
        *made,
        Figure(f"{BASE}{name}.registered", len(taken) / len(every) if every else None, "1", len(every), "higher"),
        Figure(
            f"{BASE}{name}.false_accept", wrong / len(taken) if taken else None, "1", len(taken), "lower", None,
            wilson(wrong, len(taken)) if taken else None,
        ),
        Figure(f"{BASE}{name}.weights_off_sd", _mean(scores), "sd", len(scores), "lower"),
    ]  # fmt: skip


def _median(some: Sequence[Outcome], of: Callable[[Outcome], float]) -> float | None:
    return float(np.median([of(one) for one in some])) if some else None


def _mean(values: Sequence[float]) -> float | None:
    return float(np.mean(values)) if values else None


def _shot(request: BenchRequest, folder: Path, at: RegistrationMap, modes: Modes) -> list[Figure]:
    """The real shot in the mean nose, all of it and random halves of it."""
    if not all((folder / name).is_file() for name in SHOT_FILES):
        return _of_shot(None, [])
    seen, rng = observed_shot(folder), np.random.default_rng([request.seed, 9])
    halvings, pairs = QUICK_HALVINGS if request.quick else HALVINGS, []
    with request.progress.task("a real shot", 1 + halvings) as advance:
        whole = register_deformable(at, modes, seen)
        advance(1)
        for _ in range(halvings):
            pairs.append([register_deformable(at, modes, half) for half in halves(seen, rng)])
            advance(1)
    return _of_shot(whole, pairs)


def observed_shot(folder: Path, view: str = VIEW) -> Observation:
    """A frame of the shot with all points of its reconstruction, of unknown scale."""
    made = read_reconstruction(folder)
    frame = made.view(view)
    points = made.seen_by(frame)
    return observed(made, frame, noise_of(points), unknown_scale(points))


def halves(seen: Observation, rng: np.random.Generator) -> list[Observation]:
    """An observation cut in two at random, within each of its views."""
    in_first: Int[np.ndarray, "n"] = np.zeros(len(seen), np.int64)
    edges = [*np.flatnonzero(np.diff(seen.view, prepend=-1)).tolist(), len(seen)]
    for begin, end in pairwise(edges):
        in_first[begin + rng.permutation(end - begin)[: (end - begin) // 2]] = 1
    return [seen.rows(np.flatnonzero(in_first == k)) for k in (1, 0)]


def _of_shot(whole: DeformableRegistration | None, pairs: Sequence[Sequence[DeformableRegistration]]) -> list[Figure]:
    off = [distance(one.best, other.best) for one, other in pairs]
    scales = [float(np.exp(abs(np.log(one.scale / other.scale)))) for one, other in pairs]
    n = len(pairs)
    parts = {
        "halves_mm": ([float(mm) for mm, _ in off], "mm"),
        "halves_deg": ([float(np.rad2deg(rad)) for _, rad in off], "°"),
        "halves_scale": (scales, "×"),
    }
    one = int(whole is not None)
    refused = None if whole is None else float(whole.status == "refused")
    median_mm, explained = (None, None) if whole is None else (whole.fit.median_mm, whole.fit.explained)
    return [
        Figure(f"{SFM}.residual_mm", median_mm, "mm", one, "lower"),
        Figure(f"{SFM}.explained", explained, "1", one, "higher"),
        Figure(f"{SFM}.refused", refused, "1", one, "higher"),
        *(
            Figure(f"{SFM}.{name}", float(np.median(of)) if n else None, unit, n, "lower")
            for name, (of, unit) in parts.items()
        ),
    ]
