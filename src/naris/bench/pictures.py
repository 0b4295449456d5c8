"""Registrations from a picture alone: how far away walls are, a network tells (`naris.locate.depth`).

Views of virtual patients as those of `naris.bench.trials`, each by a lens of its own (`lens`), of patients and looks
that no training had; and some along the way, half of these as `naris simulate` makes them. What another patient's
picture and a picture of something else come to is counted as well.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import cycle

import cv2
import numpy as np
from jaxtyping import Bool, UInt8

from naris.anatomy.builtin.variation import virtual_patient
from naris.anatomy.distance import signed_distance
from naris.bench import BenchRequest
from naris.bench.result import Better, Figure, wilson
from naris.bench.trials import FRAME_PX, Trial, drawn_trials, frame, trials_at
from naris.core.anatomy import Anatomy
from naris.core.camera import Brown, Intrinsics, Pinhole
from naris.core.pose import distance
from naris.core.results import Registration
from naris.core.targets import target_errors_mm, wall_ahead_mm
from naris.evaluate.score import auroc, normalised_square, reliability
from naris.locate.depth import DepthEstimator, open_depth
from naris.register.map import RegistrationMap, registration_map
from naris.register.picture import SEARCH, PictureConfig, register_picture
from naris.register.starts import NOTHING, Belief, in_region
from naris.render.appearance import ENDOSCOPE, Appearance
from naris.render.scene import Scene
from naris.render.viewpoints import INSPECTION, draw_views, passages_of, view_bank
from naris.train.strangers import strangers

PATIENTS, VIEWS, QUICK_PATIENTS, QUICK_VIEWS = 16, 10, 1, 2
VIEWS_ALONG = 8
NONE, REGION, OTHER, STRANGE = "none", "region", "other", "strange"
"""From nothing; from the true region; another patient's anatomy; a picture of something else."""
ALONG, ALONG_OTHER = "along", "along_other"
"""As an endoscopist looks, along the way: from nothing, and to another patient's anatomy."""

PICTURE_SOLVER = (
    "naris.register.picture",
    "naris.register.shading",
    "naris.register.contour",
    "naris.register.astray",
    "naris.register.noise",
    "naris.register.observation",
    "naris.locate.depth",
    "naris.locate.view",
)
"""Sources that decide where a registration of a picture ends, beside those of every registration."""

SHAPES = ((1.0, (42.0, 90.0)), (4 / 3, (42.0, 80.0)), (16 / 9, (42.0, 65.0)))
"""Width over height of pictures, and how high lenses for these see (degrees)."""

_BARREL = 0.14  # at most so much of the way to the corner: from 4/27 on its ends bend out of view
_ALONG = "register.picture.along"
_SEEDS = 7_000_000  # of the patients, apart from those of the fits and the other benchmarks
_STRANGE_EACH = 5
_DARK = 40


@dataclass(frozen=True, eq=False)
class Pictured:
    """What a registration of a picture came to.

    Attributes:
        kind: one of `NONE`, `REGION`, `OTHER`, `STRANGE`, `ALONG` and `ALONG_OTHER`.
        result: of the registration.
        off_mm, off_deg: of the best pose, from the truth; infinite where there is none in that anatomy.
        target_mm: mean error over the walls that are seen.
        normalised: the squared error over what the covariance says, a degree of freedom.
        cpu_s: of network and registration.
    """

    kind: str
    result: Registration
    off_mm: float
    off_deg: float
    target_mm: float
    normalised: float
    cpu_s: float

    @property
    def right(self) -> bool:
        return self.off_mm <= 2.0 and self.off_deg <= 5.0

    @property
    def accepted(self) -> bool:
        return self.result.status == "registered"


@dataclass(frozen=True, eq=False)
class Shots:
    """Pictures of a patient, prepared, with their trials and lenses, and another patient."""

    at: tuple[RegistrationMap, Scene]
    other: tuple[RegistrationMap, Scene]
    trials: list[Trial]
    lenses: list[Intrinsics]
    images: list[UInt8[np.ndarray, "_ _ 3"]]


def shots(nose: Anatomy, other: Anatomy, views: int, seed: int) -> Shots:
    """Of a patient, as the trials are drawn."""
    return _taken(nose, other, drawn_trials(nose, views, seed), np.random.default_rng([seed, 10]))


def shots_along(nose: Anatomy, other: Anatomy, views: int, seed: int) -> Shots:
    """Of a patient, along the way, as `naris simulate` takes them; every second one looks as its pictures do, too."""
    rng, distance_mm = np.random.default_rng([seed, 12]), signed_distance(nose, 0.5)
    bank = view_bank(distance_mm, passages_of(nose, distance_mm), nose.region_set(), INSPECTION)
    poses = draw_views(Scene(nose), bank, views, rng).anatomy_T_camera
    return _taken(nose, other, list(trials_at(nose, poses, rng)), rng, (None, ENDOSCOPE))


def _taken(
    nose: Anatomy,
    other: Anatomy,
    trials: list[Trial],
    rng: np.random.Generator,
    looks: Sequence[Appearance | None] = (None,),
) -> Shots:
    scene, lenses = Scene(nose), [lens(rng) for _ in trials]
    seen = zip(zip(trials, lenses, strict=True), cycle(looks), strict=False)  # looks begin again
    images = [frame(scene, trial, camera, rng, look) for (trial, camera), look in seen]
    return Shots((registration_map(nose), scene), (registration_map(other), Scene(other)), trials, lenses, images)


def lens(rng: np.random.Generator) -> Intrinsics:
    """Any that endoscopes have: square to wide pictures, of every angle that the network knows, half of them bent."""
    shape, angles = SHAPES[rng.integers(len(SHAPES))]
    height, angle = FRAME_PX, float(rng.uniform(*angles))
    width = round(shape * height)
    corner = float(np.hypot(width, height) / height * np.tan(np.deg2rad(angle / 2)))
    bent = rng.uniform() < 0.5
    barrel = Brown(k1=-float(rng.uniform(0, _BARREL)) / corner**2)
    return Intrinsics.from_vertical_fov(width, height, angle, barrel if bent else Pinhole())


def registered(shot: Shots, estimator: DepthEstimator, seed: int, others: int = _STRANGE_EACH) -> Iterator[Pictured]:
    """All of a patient: each picture from nothing, from the true region, in another patient; and other things."""
    regions = shot.at[0].anatomy.region_set()
    for number, (trial, image, camera) in enumerate(zip(shot.trials, shot.images, shot.lenses, strict=True)):
        seen = image, camera
        name = regions.names[int(regions.label(trial.anatomy_T_camera.position_mm))]
        yield _one(NONE, shot.at, seen, NOTHING, trial, estimator, seed + number)
        yield _one(REGION, shot.at, seen, in_region(regions, name), trial, estimator, seed + number)
        yield _one(OTHER, shot.other, seen, NOTHING, None, estimator, seed + number)
    rng = np.random.default_rng([seed, 9])
    familiar = np.stack([cv2.resize(image, (FRAME_PX, FRAME_PX)) for image in shot.images])
    for image in strangers(others, FRAME_PX, familiar, rng):
        if image.max() > _DARK:  # a black one is no picture, and is said to be none
            camera = Intrinsics.from_vertical_fov(FRAME_PX, FRAME_PX, float(rng.uniform(*SHAPES[0][1])))
            yield _one(STRANGE, shot.at, (image, camera), NOTHING, None, estimator, seed)


def registered_along(shot: Shots, estimator: DepthEstimator, seed: int) -> Iterator[Pictured]:
    """Each picture along the way from nothing, and in another patient."""
    for number, (trial, image, camera) in enumerate(zip(shot.trials, shot.images, shot.lenses, strict=True)):
        yield _one(ALONG, shot.at, (image, camera), NOTHING, trial, estimator, seed + number)
        yield _one(ALONG_OTHER, shot.other, (image, camera), NOTHING, None, estimator, seed + number)


def _one(
    kind: str,
    at: tuple[RegistrationMap, Scene],
    picture: tuple[UInt8[np.ndarray, "h w 3"], Intrinsics],
    belief: Belief,
    trial: Trial | None,
    estimator: DepthEstimator,
    seed: int,
) -> Pictured:
    begun = time.process_time()
    image, camera = picture
    seen = image, camera, estimator.estimate(image, camera)
    result = register_picture(*at, seen, belief, PictureConfig(replace(SEARCH, seed=seed)))
    spent = time.process_time() - begun
    if trial is None:
        return Pictured(kind, result, np.inf, np.inf, np.inf, np.nan, spent)
    truth = trial.anatomy_T_camera
    off_mm, off_rad = distance(result.best, truth)
    wall_mm = wall_ahead_mm(truth, trial.ranges["a"], trial.rays)
    return Pictured(
        kind,
        result,
        float(off_mm),
        float(np.rad2deg(off_rad)),
        float(target_errors_mm(result.best, truth, wall_mm).mean()),
        normalised_square(result.best, truth, result.covariance),
        spent,
    )


def figures(request: BenchRequest) -> list[Figure]:
    """Over all pictures, refusals counted as such."""
    count, views = (QUICK_PATIENTS, QUICK_VIEWS) if request.quick else (PATIENTS, VIEWS)
    estimator, done = open_depth(), list[Pictured]()
    with request.progress.task("pictures alone", count) as advance:
        for number in range(count):
            nose, other = (virtual_patient(_SEEDS + request.seed, k) for k in (number, number + PATIENTS))
            shot = shots(nose, other, views, _SEEDS + request.seed + number)
            if not number and not request.quick:  # compiles what there is to compile, so that no other pays for it
                next(registered(shot, estimator, request.seed))
            done += registered(shot, estimator, request.seed, 1 if request.quick else _STRANGE_EACH)
            along = shots_along(nose, other, 1 if request.quick else VIEWS_ALONG, _SEEDS + request.seed + number)
            done += registered_along(along, estimator, request.seed)
            advance(1)
    told = [figure for kind in (NONE, REGION, ALONG) for figure in _success(done, kind)]
    return [*told, *_belief(done, NONE, "register.picture"), *_belief(done, ALONG, _ALONG), *_refused(done)]


def _success(done: Sequence[Pictured], kind: str) -> list[Figure]:
    some = [one for one in done if one.kind == kind]
    base, n = f"register.picture.{kind}", len(some)
    right = [one.right for one in some]
    kept = [one.accepted and one.target_mm < 2.0 for one in some]
    return [
        _share(f"{base}.success", np.array(right), "higher"),
        _share(f"{base}.tre_lt2", np.array(kept), "higher"),
        Figure(f"{base}.target_mm", float(np.median([one.target_mm for one in some])), "mm", n, "lower"),
        Figure(f"{base}.cpu_s", float(np.mean([one.cpu_s for one in some])), "CPU-s", n, "lower"),
    ]


def _belief(done: Sequence[Pictured], kind: str, base: str) -> list[Figure]:
    some = [one for one in done if one.kind == kind]
    right, said = np.array([one.right for one in some]), np.array([one.result.probability for one in some])
    accepted, n = np.array([one.accepted for one in some]), len(some)
    above = auroc(said, right)
    squares = [one.normalised for one in some if one.right and one.accepted]
    return [
        Figure(f"{base}.auroc", above, "1", n if above is not None else 0, "higher"),
        Figure(f"{base}.ece", reliability(said, right).ece, "1", n, "lower"),
        _share(f"{base}.accepted", accepted, "higher"),
        _share(f"{base}.false_accept", ~right[accepted], "lower"),
        Figure(f"{base}.normalised", float(np.mean(squares)) if squares else None, "1", len(squares), "lower"),
    ]


def _refused(done: Sequence[Pictured]) -> list[Figure]:
    names = {OTHER: "wrong_patient", ALONG_OTHER: "along.wrong_patient", STRANGE: STRANGE}
    return [
        _share(
            f"register.picture.{name}.refused",
            np.array([not one.accepted for one in done if one.kind == kind]),
            "higher",
        )
        for kind, name in names.items()
    ]


def _share(name: str, which: Bool[np.ndarray, "n"], better: Better) -> Figure:
    n = len(which)
    if not n:
        return Figure(name, None, "1", 0, better)
    return Figure(name, float(which.mean()), "1", n, better, None, wilson(int(which.sum()), n))
