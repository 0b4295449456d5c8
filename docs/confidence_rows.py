"""The simulated trials that the probability of a registration is fitted on (`make_confidence.py`).

Virtual patients with views drawn as those of `naris bench register`, but of other seeds: from nothing, every second one
from the true region, with noise a to e; every second one to another patient, which are all wrong; every fifth with
noise that is said to be less or more than it is; two of five far better than said, in this patient and in another; with
two views beside every third one (b) and every fifth one (c, d, e), in both; from a pose near to the truth; two of five
with few of the points; and, of points in a unit of their own, with up to seven views beside three of five, as a
reconstruction has them, a third of those better than said, and one of five with a prior of the scale; and of depth
whose pixels are off by themselves alone, and are said to be, every second one of unknown scale, two of ten with two
views beside them and two from a pose.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, replace
from typing import NamedTuple

import numpy as np

from naris.anatomy.builtin.variation import virtual_patient
from naris.bench.problems import problem, several
from naris.bench.trials import FREE_POINTS, NOISES, POINT_MM, Noise, Trial, drawn_trials, neighbours_of
from naris.core.anatomy import Anatomy
from naris.core.pose import CAMERA, Pose, distance
from naris.evaluate.score import normalised_square
from naris.register import register as registration
from naris.register.evidence import Evidence
from naris.register.map import RegistrationMap, registration_map
from naris.register.noise import KNOWN, UNKNOWN, DepthNoise, Scale
from naris.register.observation import Observation, from_ranges, together
from naris.register.register import RegisterConfig, register
from naris.register.starts import NOTHING, Belief, in_region

ALL = (*NOISES, FREE_POINTS)
SEED, PATIENTS, VIEWS = 3_000_000, 36, 10
MISTOLD = {"understated": 0.6, "overstated": 1.7}
"""What the deviations of the noise are multiplied with where they are told wrong."""
_ENDLESS = 1e9  # JSON has no word for it; for features it is the same
_FEW_POINTS = (30, 250)
_SHOT_VIEWS, _SHOT_POINTS = (2, 8), (60, 300)
_PRIOR_SD = 0.1  # of the logarithm of the scale
_GRAIN_MM, _LEAST_RANGE_MM = (0.1, 1.5), 0.2


class Row(NamedTuple):
    """One registration for the fit.

    Attributes:
        kind: how it began with which noise.
        evidence: what spoke for it.
        right: whether it was.
        normalised: the square of its error over the covariance, a degree of freedom; 1 on average where that is right.
    """

    kind: str
    evidence: Evidence
    right: bool
    normalised: float

    def to_json(self) -> list[object]:
        """Its parts in their order."""
        evidence = {name: min(value, _ENDLESS) for name, value in asdict(self.evidence).items()}
        return [self.kind, evidence, self.right, self.normalised]


def of_patient(number: int) -> Iterator[Row]:
    """All that is registered of a patient's views."""
    nose = virtual_patient(SEED, number)
    at, other = registration_map(nose), registration_map(virtual_patient(SEED, (number - 1) % PATIENTS))
    regions = nose.region_set()
    for view, trial in enumerate(drawn_trials(nose, VIEWS, SEED + number)):
        region = regions.names[int(regions.label(trial.anatomy_T_camera.position_mm))]
        if view % 3 == 0:
            yield from _in_both("views b", (at, other), problem(at, trial, "b", "views3", view).look(), trial, view)
        for noise in ALL:
            seen = trial.observation(noise)
            yield one(f"none {noise}", at, seen, NOTHING, trial, RegisterConfig(seed=view))
            if view % 2 == 0:
                yield one(f"region {noise}", at, seen, in_region(regions, region), trial, RegisterConfig(seed=view))
            else:
                yield one(f"other {noise}", other, seen, NOTHING, trial, RegisterConfig(seed=view))
            for how, factor in MISTOLD.items() if view % 5 == 3 else ():
                told = replace(
                    seen, radial=factor * seen.radial, isotropic=factor * seen.isotropic, smooth=factor * seen.smooth
                )
                yield one(f"{how} {noise}", at, told, NOTHING, trial, RegisterConfig(seed=view))
    yield from _better_and_several(nose, at, other, SEED + number)
    yield from _from_pose(nose, at, other, SEED + number)
    yield from _of_few_points(nose, at, other, SEED + number)
    yield from _of_reconstructions(nose, at, other, SEED + number)
    yield from _of_better_reconstructions(nose, at, other, SEED + number)
    yield from _of_grain(nose, at, other, SEED + number)


def _from_pose(nose: Anatomy, at: RegistrationMap, other: RegistrationMap, seed: int) -> Iterator[Row]:
    for view, trial in enumerate(drawn_trials(nose, VIEWS, seed)):
        for noise in ALL[1:]:
            look, belief, config = problem(at, trial, noise, "pose", view)
            yield one(f"pose {noise}", at, look(), belief, trial, config)
            if view % 2 == 1:
                yield one(f"other pose {noise}", other, look(), belief, trial, config)


def _of_few_points(nose: Anatomy, at: RegistrationMap, other: RegistrationMap, seed: int) -> Iterator[Row]:
    rng = np.random.default_rng([seed, 10])
    for view, trial in enumerate(drawn_trials(nose, VIEWS, seed)):
        for noise in ("d", FREE_POINTS) if view % 5 in (0, 4) else ():
            seen = trial.observation(noise).some(int(rng.integers(*_FEW_POINTS)))
            yield from _in_both(f"few {noise}", (at, other), seen, trial, view)


def _of_reconstructions(nose: Anatomy, at: RegistrationMap, other: RegistrationMap, seed: int) -> Iterator[Row]:
    """Points of several views in a unit of their own, or of one with a prior of its scale."""
    rng = np.random.default_rng([seed, 11])
    for view, trial in enumerate(drawn_trials(nose, VIEWS, seed)):
        if view % 5 == 4:
            continue
        if view % 5 == 1:
            kind, seen = "views", problem(at, trial, FREE_POINTS, "views3", view).look()
        elif view % 5 in (0, 3):
            kind, seen = "shot", as_reconstructed(nose, trial, rng)
        else:
            factor = float(np.exp(_PRIOR_SD * rng.standard_normal())) / trial.scale
            prior = Scale("prior", factor=factor, sd_log=_PRIOR_SD)
            kind, seen = "prior", replace(trial.observation(FREE_POINTS), scale=prior)
        yield from _in_both(f"{kind} {FREE_POINTS}", (at, other), seen, trial, view)


def _of_better_reconstructions(nose: Anatomy, at: RegistrationMap, other: RegistrationMap, seed: int) -> Iterator[Row]:
    """Of less noise than said: whoever takes a usual one for it says too much more often than too little."""
    rng = np.random.default_rng([seed, 12])
    for view, trial in enumerate(drawn_trials(nose, VIEWS, seed)):
        if view % 5 == 4:
            seen = as_reconstructed(nose, trial, rng, better=True)
            yield from _in_both(f"better shot {FREE_POINTS}", (at, other), seen, trial, view)


def _of_grain(nose: Anatomy, at: RegistrationMap, other: RegistrationMap, seed: int) -> Iterator[Row]:
    """Depth without a smooth error, of which that is said: its noise hides some of what other walls would show."""
    rng = np.random.default_rng([seed, 13])
    for view, trial in enumerate(drawn_trials(nose, VIEWS, seed)):
        noise: Noise = "b" if view % 2 == 0 else "c"
        pixel_mm = float(np.exp(rng.uniform(*np.log(_GRAIN_MM))))
        if view % 5 == 2:
            views, rig_T_camera = neighbours_of(nose, trial, 2, view)
            scale = trial.scale if noise == "c" else 1.0
            rig_T_camera = Pose.of(rig_T_camera.rotation, scale * rig_T_camera.position_mm, CAMERA, CAMERA)
            seen = together([_grainy(one, noise, scale, pixel_mm, rng) for one in views], rig_T_camera)
            yield from _in_both(f"grain views {noise}", (at, other), seen, trial, view)
            continue
        seen = _grainy(trial, noise, trial.scale if noise == "c" else 1.0, pixel_mm, rng)
        if view % 5 == 4:
            _, belief, config = problem(at, trial, noise, "pose", view)
            yield one(f"grain pose {noise}", at, seen, belief, trial, config)
            yield one(f"other grain pose {noise}", other, seen, belief, trial, config)
        else:
            yield from _in_both(f"grain {noise}", (at, other), seen, trial, view)


def _grainy(trial: Trial, noise: Noise, scale: float, pixel_mm: float, rng: np.random.Generator) -> Observation:
    """Exact ranges in a unit, with noise of each pixel by itself; what came too near is not known."""
    exact = trial.ranges["a"]
    ranges = exact + pixel_mm * rng.standard_normal(exact.shape)
    ranges = scale * np.where(ranges > _LEAST_RANGE_MM, ranges, np.nan)
    told = DepthNoise(smooth=0.0, pixel_mm=scale * pixel_mm)
    return from_ranges(ranges, trial.rays, told, UNKNOWN if noise == "c" else KNOWN)


def as_reconstructed(nose: Anatomy, trial: Trial, rng: np.random.Generator, *, better: bool = False) -> Observation:
    """Some points of several views about that of a trial, in one unit."""
    views, rig_T_camera = neighbours_of(nose, trial, int(rng.integers(*_SHOT_VIEWS)), int(rng.integers(2**31)))
    of_each = int(rng.integers(*_SHOT_POINTS))
    if better:
        factor = rng.uniform(0.0, 0.5)
        views = [replace(one, points=_better_points(one, factor, rng)) for one in views]
    return several([replace(one, points=one.points[:of_each]) for one in views], rig_T_camera, FREE_POINTS)


def _better_and_several(nose: Anatomy, at: RegistrationMap, other: RegistrationMap, seed: int) -> Iterator[Row]:
    rng = np.random.default_rng([seed, 9])
    for view, trial in enumerate(drawn_trials(nose, VIEWS, seed)):
        if view % 5 not in (1, 2):
            continue
        for noise in ALL[1:]:
            seen = better_than_said(trial, noise, rng)
            yield from _in_both(f"better {noise}", (at, other), seen, trial, view)
        for noise in ("c", "d") if view % 5 == 1 else ():
            seen = problem(at, trial, noise, "views3", view).look()
            yield from _in_both(f"views {noise}", (at, other), seen, trial, view)


def better_than_said(trial: Trial, noise: Noise, rng: np.random.Generator) -> Observation:
    """Told as noise b to e, with up to half of it: as of who is careful, or does not know how good a cloud is."""
    exact = trial.ranges["a"]
    if noise in ("b", "c"):
        better = exact + rng.uniform(0.0, 0.5) * (trial.ranges["b"] - exact)
        return replace(trial, ranges={"b": better, "c": trial.scale * better}).observation(noise)
    return replace(trial, points=_better_points(trial, None, rng)).observation(noise)


def _better_points(trial: Trial, factor: float | None, rng: np.random.Generator) -> np.ndarray:
    """As many points without outliers, their noise times a factor, which is drawn where there is none."""
    exact = trial.ranges["a"]
    chosen = rng.choice(np.flatnonzero(np.isfinite(exact)), len(trial.points), replace=False)
    points = trial.rays.reshape(-1, 3)[chosen] * exact.reshape(-1, 1)[chosen]
    factor = rng.uniform(0.0, 0.5) if factor is None else factor
    return np.asarray(points + factor * POINT_MM * rng.standard_normal(points.shape))


def _in_both(
    kind: str, maps: tuple[RegistrationMap, RegistrationMap], seen: Observation, trial: Trial, view: int
) -> Iterator[Row]:
    """From nothing, in the patient and in another."""
    for name, at in zip((kind, f"other {kind}"), maps, strict=True):
        yield one(name, at, seen, NOTHING, trial, RegisterConfig(seed=view))


def one(kind: str, at: RegistrationMap, seen: Observation, belief: Belief, trial: Trial, config: RegisterConfig) -> Row:
    """One registration, judged by the truth; to another patient it is wrong wherever it ends."""
    kept = []

    def keep(evidence: Evidence) -> float:
        kept.append(evidence)
        return 0.5

    registration.probability, registration.covariance_factor = keep, lambda _: 1.0
    result = register(at, seen, belief, config)
    off_mm, off_rad = distance(result.best, trial.anatomy_T_camera)
    square = normalised_square(result.best, trial.anatomy_T_camera, result.covariance)
    right = bool(off_mm <= 2.0 and np.rad2deg(off_rad) <= 5.0) and not kind.startswith("other")
    return Row(kind, kept[0], right, square)
