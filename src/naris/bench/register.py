"""How often a registration ends at the truth, from what start, at what cost, and how well it knows.

Over all trials. A success is a best pose within 2 mm and 5°, refused or not, which tells how well one searches and
solves; `.answered` counts those that were not refused as well, which is what a user gets. The frozen trials in the mean
nose are measured where they are given (`--scans`); views of virtual patients always are.
"""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources

import numpy as np
from jaxtyping import Bool

from naris.anatomy.builtin.variation import virtual_patient
from naris.bench import BenchRequest, Measurement, cissticp, contours, deformable, peer_trials, pictures, shot
from naris.bench.problems import SOLVED_POINTS, Start, near_truth, problem, told_pose
from naris.bench.result import Figure, wilson
from naris.bench.trials import (
    FREE_POINTS,
    FROZEN,
    MEAN,
    NOISES,
    Noise,
    Trial,
    drawn_trials,
    frozen_setting,
    has_frozen,
)
from naris.core.pose import distance
from naris.core.provenance import file_digest
from naris.core.results import Registration
from naris.core.targets import target_errors_mm
from naris.evaluate.score import auroc, normalised_square, reliability
from naris.register.confidence import FITTED
from naris.register.map import RegistrationMap, registration_map
from naris.register.noise import DepthNoise
from naris.register.observation import from_ranges
from naris.register.register import RegisterConfig, register
from naris.register.solve import coarse
from naris.register.starts import NOTHING, Starts

PATIENTS, VIEWS = 20, 10
QUICK_PATIENTS, QUICK_VIEWS = 1, 4
OF_PATIENTS = ".patients"
GOALS = {
    "region": {"a": 1.0, "b": 0.85, "c": 0.70, "d": 0.80},
    "none": {"b": 0.80, "c": 0.65, "d": 0.75},
    "views3": {"b": 0.93, "c": 0.85},
    "pose": {"b": 0.85},
}
CPU_GOALS_S = {"region": 0.3, "none": 1.0, "pose": 0.02}
_OTHERS = 2_000_000  # seeds of the patients here, apart from those that the confidence is fitted on
SEARCH = (
    "cloud",
    "cloud_equations",
    "compare",
    "directions",
    "equations",
    "evidence",
    "predictive",
    "rays",
    "register",
    "smooth",
    "solve",
    "starts",
    "steps",
)
"""Sources in `naris.register` that decide where a registration of an observation ends and what speaks for it."""
_STRANGE: tuple[Noise, ...] = ("a", "b", "c", "d", FREE_POINTS)
_ONE_VIEW: tuple[Start, ...] = ("region", "none")
_APART = 1000  # seeds of one patient's views from those of the next, and from those that the confidence is fitted on
_REPEATS = 200


@dataclass(frozen=True, eq=False)
class Outcome:
    """One registration beside the truth.

    Attributes:
        off_mm, off_deg: of the best pose.
        cpu_s: what it took.
        result: itself.
        normalised: the square of its error over its covariance.
        landmarks_mm: mean target registration error of the anatomy's landmarks; None where it has none.
    """

    off_mm: float
    off_deg: float
    cpu_s: float
    result: Registration
    normalised: float
    landmarks_mm: float | None

    @property
    def answered(self) -> bool:
        return self.result.status == "registered"

    @property
    def right(self) -> bool:
        return self.off_mm <= 2.0 and self.off_deg <= 5.0

    @property
    def close(self) -> bool:
        return self.off_mm <= 1.0 and self.off_deg <= 3.0


@dataclass(frozen=True, eq=False)
class Setting:
    """An anatomy, prepared once for all its trials, those, and the seed of the first of them."""

    at: RegistrationMap
    trials: Sequence[Trial]
    seed: int


def measure(request: BenchRequest) -> Measurement:
    """All figures, or those of a part: trials, the runs of cisstICP, peers in our solver's place, shapes, contours,
    pictures alone, and those of a real shot."""
    figures = of_trials(request) if request.wants("trials") else []
    if request.wants("cissticp"):
        figures += cissticp.figures(request)
    if request.wants("peers"):
        figures += peer_trials.figures(request)
    if request.wants("deformable"):
        figures += deformable.figures(request)
    if request.wants("contours"):
        figures += contours.figures(request)
    if request.wants("pictures"):
        figures += pictures.figures(request)
    if request.wants("shot"):
        figures += shot.figures(request)
    return Measurement(tuple(figures), _inputs(request))


def of_trials(request: BenchRequest) -> list[Figure]:
    """On virtual patients with `.patients` behind their names, then on the frozen trials."""
    sets = _sets(request)
    figures: list[Figure] = []
    known: dict[str, list[Outcome]] = {}
    for suffix, settings in sets:
        _warm_up(settings[0])
        for start in _ONE_VIEW:
            for noise in (*NOISES, FREE_POINTS):
                done = _run(request, f"{start} {noise}{suffix}", settings, noise, start)
                known[f"{start}.{noise}{suffix}"] = done
                figures += _of(f"register.{start}.{noise}{suffix}", done, start, noise)
        figures += _of(f"register.pose.b{suffix}", _run(request, f"pose b{suffix}", settings, "b", "pose"), "pose", "b")
        figures.append(_right_at_start(f"register.pose.b{suffix}.right_at_start", settings))
        for noise in NOISES:
            done = _run(request, f"three views {noise}{suffix}", settings, noise, "views3")
            known[f"views3.{noise}{suffix}"] = done
            figures += _of(f"register.views3.{noise}{suffix}", done, "views3", noise)
    unsure = [one for noise in "bcd" for one in known[f"none.{noise}{OF_PATIENTS}"]]
    figures += of_confidence(unsure)
    figures += [of_covariance(noise, known[f"none.{noise}{OF_PATIENTS}"]) for noise in (*NOISES[1:], FREE_POINTS)]
    figures += [of_covariance(f"views3.{noise}", known[f"views3.{noise}{OF_PATIENTS}"]) for noise in ("b", "c", "d")]
    patients = sets[0][1]
    return [*figures, _solve_ms(sets[-1][1][0]), *_wrong_patients(request, patients), _mirrored(request, patients)]


def _sets(request: BenchRequest) -> list[tuple[str, list[Setting]]]:
    count, views = (QUICK_PATIENTS, QUICK_VIEWS) if request.quick else (PATIENTS, VIEWS)
    patients = []
    with request.progress.task("virtual patients", count) as advance:
        for number in range(count):
            nose = virtual_patient(_OTHERS + request.seed, number)
            seen = drawn_trials(nose, views, request.seed + number)
            patients.append(Setting(registration_map(nose), seen, request.seed + _APART * (number + 1)))
            advance(1)
    sets = [(OF_PATIENTS, patients)]
    if request.scans is not None and has_frozen(request.scans):
        mean, trials = frozen_setting(request.scans)
        sets.append(
            ("", [Setting(registration_map(mean), trials[:QUICK_VIEWS] if request.quick else trials, request.seed)])
        )
    return sets


def _run(request: BenchRequest, what: str, settings: Sequence[Setting], noise: Noise, start: Start) -> list[Outcome]:
    done = []
    with request.progress.task(what, sum(len(setting.trials) for setting in settings)) as advance:
        for setting in settings:
            at = setting.at
            for number, trial in enumerate(setting.trials):
                done.append(_once(at, trial, noise, start, setting.seed + number))
                advance(1)
    return done


def _once(at: RegistrationMap, trial: Trial, noise: Noise, start: Start, seed: int) -> Outcome:
    look, belief, config = problem(at, trial, noise, start, seed)
    begun = time.process_time()
    result = register(at, look(), belief, config)
    spent = time.process_time() - begun
    off_mm, off_rad = distance(result.best, trial.anatomy_T_camera)
    normalised = normalised_square(result.best, trial.anatomy_T_camera, result.covariance)
    marks = list(at.anatomy.landmarks_mm.values())
    tre_mm = float(target_errors_mm(result.best, trial.anatomy_T_camera, np.stack(marks)).mean()) if marks else None
    return Outcome(float(off_mm), float(np.rad2deg(off_rad)), spent, result, normalised, tre_mm)


def _right_at_start(name: str, settings: Sequence[Setting]) -> Figure:
    """How many of the poses near the truth that are told count as right before anything is solved."""
    right = []
    for setting in settings:
        for number, trial in enumerate(setting.trials):
            told = told_pose(trial, setting.seed + number)
            off_mm, off_rad = distance(told, trial.anatomy_T_camera)
            right.append(off_mm <= 2.0 and np.rad2deg(off_rad) <= 5.0)
    return Figure(name, float(np.mean(right)), "1", len(right), "higher")


def _of(name: str, done: Sequence[Outcome], start: str, noise: str) -> list[Figure]:
    n = len(done)
    right = np.array([one.right for one in done])
    cpu = float(np.mean([one.cpu_s for one in done]))
    goal = GOALS[start].get(noise)
    answered = np.array([one.answered for one in done])
    told = right & answered
    made = [
        Figure(f"{name}.success", float(right.mean()), "1", n, "higher", goal, wilson(int(right.sum()), n)),
        Figure(f"{name}.close", float(np.mean([one.close for one in done])), "1", n, "higher"),
        Figure(f"{name}.answered", float(told.mean()), "1", n, "higher", None, wilson(int(told.sum()), n)),
        Figure(f"{name}.refused", float(np.mean(~answered)), "1", n, "lower"),
        Figure(f"{name}.cpu_s", cpu, "CPU-s", n, "lower", CPU_GOALS_S.get(start)),
    ]
    marks = [one.landmarks_mm for one in done if one.landmarks_mm is not None]
    if marks:
        made.append(Figure(f"{name}.landmarks_tre_median_mm", float(np.median(marks)), "mm", len(marks), "lower"))
    return made


def of_confidence(done: Sequence[Outcome]) -> list[Figure]:
    """How well the probability parts right from wrong, and whether it is what it says."""
    right = np.array([one.right for one in done])
    said = np.array([one.result.probability for one in done])
    base, n = "register.confidence", len(done)
    above = auroc(said, right)
    order = np.argsort(-said, kind="stable")
    taken = order[: round(0.8 * n)]
    return [
        Figure(f"{base}.auroc", above, "1", n if above is not None else 0, "higher", 0.97),
        _rate(f"{base}.false_accept_at_80", ~right[taken], 0.01),
        Figure(f"{base}.ece", reliability(said, right).ece, "1", n, "lower", 0.03),
        Figure(f"{base}.accepted", float(np.mean([one.answered for one in done])), "1", n, "higher"),
        _rate(f"{base}.false_accept", ~right[[one.answered for one in done]]),
    ]


def of_covariance(name: str, done: Sequence[Outcome]) -> Figure:
    """How large the errors of right poses are, squared, beside what their covariances say: 1 if those are true.

    Larger is worse than smaller, for it says too much.
    """
    squares = [one.normalised for one in done if one.right and one.answered]
    value = float(np.mean(squares)) if squares else None
    return Figure(f"register.covariance.{name}.normalised", value, "1", len(squares), "lower")


def _rate(name: str, wrong: Bool[np.ndarray, "n"], goal: float | None = None) -> Figure:
    """The share of wrong ones among those that were accepted."""
    n, count = len(wrong), int(wrong.sum())
    value = count / n if n else None
    return Figure(name, value, "1", n, "lower", goal, wilson(count, n) if n else None)


def _solve_ms(setting: Setting) -> Figure:
    """One coarse solve of as many points as the issue names, from poses beside the truth."""
    at, trial = setting.at, setting.trials[0]
    rng = np.random.default_rng(7)
    poses = np.stack([near_truth(trial, rng).matrix for _ in range(_REPEATS)])
    starts = Starts(poses, np.zeros(len(poses)))
    seen = trial.observation("b").some(SOLVED_POINTS)
    coarse(at, seen, starts, most_rays=SOLVED_POINTS, every=True)
    begun = time.process_time()
    coarse(at, seen, starts, most_rays=SOLVED_POINTS, every=True)
    spent = (time.process_time() - begun) / len(poses)
    return Figure("register.solve.cpu_ms", 1e3 * spent, "ms", len(poses), "lower", 1.5)


def _wrong_patients(request: BenchRequest, settings: Sequence[Setting]) -> list[Figure]:
    """Views of one patient registered to another: how many are refused, of depth (b) and of all that may be seen."""
    refused: dict[str, list[bool]] = {noise: [] for noise in _STRANGE}
    others = [settings[-1], *settings[:-1]] if len(settings) > 1 else [_stranger(request)]
    with request.progress.task("wrong patients", len(settings)) as advance:
        for setting, other in zip(settings, others, strict=True):
            for number, trial in enumerate(setting.trials):
                for noise in _STRANGE:
                    result = register(other.at, trial.observation(noise), NOTHING, RegisterConfig(seed=number))
                    refused[noise].append(result.status == "refused")
            advance(1)
    base = "register.wrong_patient"
    return [
        Figure(
            f"{base}.refused" if noise == "b" else f"{base}.{noise}.refused",
            float(np.mean(each)),
            "1",
            len(each),
            "higher",
            0.95,
            wilson(sum(each), len(each)),
        )
        for noise, each in refused.items()
    ]


def _mirrored(request: BenchRequest, settings: Sequence[Setting]) -> Figure:
    """Views of a patient (b) in which left is right, as a file that was flipped shows them: how many are refused."""
    refused: list[bool] = []
    with request.progress.task("mirrored views", len(settings)) as advance:
        for setting in settings:
            for number, trial in enumerate(setting.trials):
                flipped = from_ranges(trial.ranges["b"][:, ::-1], trial.rays, DepthNoise())
                result = register(setting.at, flipped, NOTHING, RegisterConfig(seed=number))
                refused.append(result.status == "refused")
            advance(1)
    n, count = len(refused), sum(refused)
    return Figure("register.mirrored.refused", count / n, "1", n, "higher", None, wilson(count, n))


def _stranger(request: BenchRequest) -> Setting:
    nose = virtual_patient(_OTHERS + request.seed, PATIENTS)
    return Setting(registration_map(nose), (), request.seed)


def _warm_up(setting: Setting) -> None:
    """Compiles what there is to compile, so that no trial pays for it."""
    at = setting.at
    for noise in (*NOISES, FREE_POINTS):
        register(at, setting.trials[0].observation(noise))


def search_digest(more: tuple[str, ...] = ()) -> str:
    """Of the sources in `SEARCH`, and of some more modules."""
    modules = [module.rpartition(".") for module in (*(f"naris.register.{name}" for name in SEARCH), *more)]
    content = b"".join(resources.files(room).joinpath(f"{name}.py").read_bytes() for room, _, name in modules)
    return hashlib.sha256(content).hexdigest()[:12]


def solver_digest() -> str:
    """Of the sources in `SEARCH`, and of what makes a probability of what they find."""
    return search_digest(("naris.register.confidence",))


def of_which_solver() -> str:
    """Whether the confidence was fitted on the solver as it is."""
    fitted = json.loads(resources.files("naris.register").joinpath(FITTED).read_text(encoding="utf-8")).get("solver")
    here = solver_digest()
    return f"fitted on this solver, {here}" if fitted == here else f"fitted on another solver, {fitted}; this is {here}"


def _inputs(request: BenchRequest) -> dict[str, str]:
    told = {
        "patients": "built-in noses of drawn parameters, seeds apart from those of the confidence",
        "confidence": of_which_solver(),
    }
    for name in (FROZEN, MEAN, cissticp.MESH, f"{deformable.SHOT}/structure.ply"):
        if request.scans is not None and (request.scans / name).is_file():
            told[name] = f"SHA-256 {file_digest(request.scans / name)}"
    return told
