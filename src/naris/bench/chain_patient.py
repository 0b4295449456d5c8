"""One patient of the chain: its own networks, frames at places that they have not seen, and a registration of each."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import cast

import numpy as np
from jaxtyping import UInt8

from naris.airway.segment import segment_airway
from naris.anatomy.builtin.variation import virtual_patient
from naris.anatomy.folder import DESCRIPTION, load_anatomy, save_anatomy
from naris.anatomy.scanned import anatomy_of_airway
from naris.bench.chain_record import Fit, FrameRecord, Outcome, PatientRecord, read_record, write_record
from naris.bench.in_our_place import OURS, Solver, solver_of
from naris.bench.trials import CAMERA_OF_TRIALS, FRAME_PX, Noise, Trial, drawn_trials, frames
from naris.core.anatomy import Anatomy, RegionSet
from naris.core.pose import Pose, distance, stack
from naris.core.progress import Progress
from naris.core.provenance import commit
from naris.core.results import Prediction
from naris.core.targets import target_errors_mm, wall_ahead_mm
from naris.ct.read import read_scan
from naris.dataset.stream import ViewStream, view_stream
from naris.demo import LOOKS
from naris.experiment.start_weights import knows, start_for
from naris.locate import locate
from naris.model.localizer import Localizer, open_localizer
from naris.register.libraries import LIBRARIES
from naris.register.map import RegistrationMap, registration_map
from naris.register.observation import Observation
from naris.register.register import FROM_POSE, RegisterConfig, register
from naris.register.starts import NOTHING, Belief, in_region, near, of_prediction
from naris.render.scene import Scene
from naris.render.viewpoints import ViewDistribution
from naris.train import COMPACT_DEMO, PUBLISHED, TrainConfig, TrainingRun, train
from naris.train.loop import RUN

COMPACT, TWO_LAYER = "compact", "two_layer"
CHAIN_NOISES: tuple[Noise, ...] = ("b", "c")
PREDICTION, REGIONS, HARD, TWO_LAYER_REGIONS = "prediction", "regions", "hard", TWO_LAYER
TRUE_REGION, NO_REGION, TRUTH = "true", "none", "truth"
BELIEFS = (PREDICTION, REGIONS, HARD, TWO_LAYER_REGIONS, TRUE_REGION, NO_REGION, TRUTH)
"""What a registration is told: the whole prediction; of it the probabilities of the regions, or the most probable one
as if it were sure; those probabilities by the published network; the true region; nothing; the true pose, which shows
what the depth alone allows."""

AS_THE_TRIALS = ViewDistribution(
    "trials",
    clearance_mm=1.0,
    tilt_sd_deg=None,
    tilt_max_deg=90.0,
    roll_sd_deg=17.0,
    median_depth_mm=3.0,
    balanced=True,
)
"""Views like those of the trials, which look up to 90° off the way: one learns what one is asked."""

SAME_STARTS = (OURS, *LIBRARIES)
"""Solvers from the same few starts, told the whole prediction."""

FRAMES = "frames.json"
_PATIENTS = 4_000_000  # seeds apart from those of the confidence and of the other trials
_AT_TRUTH = np.diag([0.1**2] * 3 + [0.01**2] * 3)


@dataclass(frozen=True)
class ChainConfig:
    """How much of what.

    Attributes:
        fit_steps: of the compact network in each patient. Steps and not seconds, so that a machine that is busy with
            other things gives the same network; the seconds are among the figures.
        two_layer_steps: of the published network there, 20 pictures each.
        views, scan_views: frames of a virtual patient and of a real scan.
        seed: of everything.
    """

    fit_steps: int = 3000
    two_layer_steps: int = 100
    views: int = 10
    scan_views: int = 30
    seed: int = 0

    def views_of(self, patient: Patient) -> int:
        return self.views if patient.scan is None else self.scan_views


@dataclass(frozen=True)
class Patient:
    """Who is measured: a virtual patient by number, or the scan in a file."""

    key: str
    number: int
    scan: Path | None = None

    def anatomy(self, seed: int) -> Anatomy:
        """Makes it (a minute).

        Raises:
            ScanError: if there is no nose in the scan.
        """
        if self.scan is None:
            return virtual_patient(_PATIENTS + seed, self.number)
        return anatomy_of_airway(segment_airway(read_scan(self.scan).volume), self.key, self.scan.name).anatomy


@dataclass(frozen=True, eq=False)
class Seen:
    """A frame with what the networks say of it, and the CPU seconds that each took for it."""

    trial: Trial
    said: Mapping[str, Prediction]
    cpu_s: Mapping[str, float]


def measured(patient: Patient, config: ChainConfig, folder: Path, progress: Progress) -> PatientRecord:
    """Everything of a patient, or what is still missing of it in its folder.

    Raises:
        InputError: if the folder holds something else.
        DiskFull: if there is no room; what is there is whole.
    """
    path, views, seed = folder / FRAMES, config.views_of(patient), _seed(patient, config)
    known = read_record(path)
    if known is not None and len(known.frames) >= views:
        return known
    anatomy, trials = _problem(patient, config, folder, progress)
    at = registration_map(anatomy)
    runs = fitted(anatomy, trials, config, folder, progress)
    localizers = {name: open_localizer(run.checkpoint) for name, run in runs.items()}
    fit = Fit(runs[COMPACT].wall_s, runs[COMPACT].cpu_s, runs[COMPACT].pictures)
    record = known or PatientRecord(patient.key, f"{anatomy.name}, {anatomy.digest}", patient.scan is not None, fit)
    images = frames(anatomy, trials, seed)
    others = _others(anatomy, config.seed)
    # What there is to compile is compiled by a frame that does not count, so that no other pays for it.
    of_frame(at, _looked_at(trials[0], images[0], localizers), seed, others)
    with progress.task(f"{patient.key}: frames", views) as advance:
        advance(len(record.frames))
        for number in range(len(record.frames), views):
            seen = _looked_at(trials[number], images[number], localizers)
            record = record.with_frame(of_frame(at, seen, seed + number, others))
            write_record(record, path)
            advance(1)
    return record


def is_learned(patient: Patient, config: ChainConfig, folder: Path) -> bool:
    """Whether the networks of a patient are there, or all that they are for.

    Raises:
        InputError: if its folder holds something else.
    """
    known = read_record(folder / FRAMES)
    is_whole = known is not None and len(known.frames) >= config.views_of(patient)
    return is_whole or all((folder / name / RUN).is_file() for name in (COMPACT, TWO_LAYER))


def learn(patient: Patient, config: ChainConfig, folder: Path, progress: Progress) -> None:
    """The networks of a patient and what they need, which `measured` finds then; raises as it does."""
    anatomy, trials = _problem(patient, config, folder, progress)
    fitted(anatomy, trials, config, folder, progress)


def _problem(
    patient: Patient, config: ChainConfig, folder: Path, progress: Progress
) -> tuple[Anatomy, Sequence[Trial]]:
    with progress.task(f"{patient.key}: preparing", 2) as advance:
        anatomy = _anatomy(patient, config, folder / "anatomy")
        advance(1)
        trials = drawn_trials(anatomy, config.views_of(patient), _seed(patient, config))
        advance(1)
    return anatomy, trials


def _seed(patient: Patient, config: ChainConfig) -> int:
    return config.seed + 1000 * (patient.number + 1)


def _anatomy(patient: Patient, config: ChainConfig, folder: Path) -> Anatomy:
    """As its folder keeps it, so that the first run and a later one see the same."""
    if not (folder / DESCRIPTION).is_file():
        save_anatomy(patient.anatomy(config.seed), folder)
    return load_anatomy(folder)


def fitted(
    anatomy: Anatomy, trials: Sequence[Trial], config: ChainConfig, folder: Path, progress: Progress
) -> dict[str, TrainingRun]:
    """The networks of a patient; none of their views is near one of the trials."""
    small, large = COMPACT_DEMO.network.input_px, FRAME_PX
    regions, unseen = anatomy.region_set(), stack([trial.anatomy_T_camera for trial in trials])
    camera = CAMERA_OF_TRIALS.resized(small, small)
    stream = view_stream(Scene(anatomy), regions, AS_THE_TRIALS, LOOKS, camera, config.seed).away_from(unseen)
    larger = replace(stream, intrinsics=CAMERA_OF_TRIALS.resized(large, large))
    two_layer = PUBLISHED.lasting(steps=config.two_layer_steps)
    return {
        COMPACT: _compact(stream, config.fit_steps, folder, progress),
        TWO_LAYER: _trained(larger, two_layer, TWO_LAYER, folder, progress),
    }


def _compact(stream: ViewStream, steps: int, folder: Path, progress: Progress) -> TrainingRun:
    """From the weights that know other noses, as in the demo, where those know the regions."""
    config = COMPACT_DEMO.lasting(steps=steps)
    if not knows(stream.regions):
        return _trained(stream, config.with_(frozen=0), COMPACT, folder, progress)
    out = folder / COMPACT
    return train(stream, config, out, start=start_for(stream), progress=progress, task=f"{folder.name}: {COMPACT}")


def _trained(stream: ViewStream, config: TrainConfig, key: str, folder: Path, progress: Progress) -> TrainingRun:
    return train(stream, config, folder / key, progress=progress, task=f"{folder.name}: {key}")


def _looked_at(trial: Trial, image: UInt8[np.ndarray, "h w 3"], localizers: Mapping[str, Localizer]) -> Seen:
    camera = CAMERA_OF_TRIALS.resized(FRAME_PX, FRAME_PX)
    said, spent = {}, {}
    for name, localizer in localizers.items():
        begun = time.process_time()
        (said[name],) = locate([image], localizer, intrinsics=camera, threads=1)
        spent[name] = time.process_time() - begun
    return Seen(trial, said, spent)


def _others(anatomy: Anatomy, seed: int) -> dict[str, Solver]:
    """Those that are installed, made ready."""
    ready = {name: solver_of(name, anatomy, seed) for name in SAME_STARTS}
    return {name: solver for name, solver in ready.items() if not isinstance(solver, str)}


def of_frame(at: RegistrationMap, seen: Seen, seed: int, others: Mapping[str, Solver]) -> FrameRecord:
    """Every noise with every belief by our solver, with the prediction by the others too."""
    regions, truth = at.anatomy.region_set(), seen.trial.anatomy_T_camera
    compact = seen.said[COMPACT]
    off_mm, off_rad = distance(cast(Pose, compact.hypotheses)[0], truth)
    believed = beliefs(regions, seen.said, truth)
    found: dict[str, dict[str, Outcome]] = {
        noise: {name: _outcome(at, seen, noise, name, belief, seed) for name, belief in believed.items()}
        for noise in CHAIN_NOISES
    }
    return FrameRecord(
        regions.names[int(regions.label(truth.position_mm))],
        {name: prediction.region_name for name, prediction in seen.said.items()},
        float(off_mm),
        float(np.rad2deg(off_rad)),
        found,
        {noise: _by_others(at, seen, noise, believed[PREDICTION], others) for noise in CHAIN_NOISES},
        commit(),
    )


def beliefs(regions: RegionSet, said: Mapping[str, Prediction], truth: Pose) -> dict[str, Belief]:
    """By name, in the order of `BELIEFS`."""
    whole, published = of_prediction(said[COMPACT], regions), of_prediction(said[TWO_LAYER], regions)
    return {
        PREDICTION: whole,
        REGIONS: replace(whole, poses=None, covariance=None),
        HARD: in_region(regions, said[COMPACT].region_name),
        TWO_LAYER_REGIONS: replace(published, poses=None, covariance=None),
        TRUE_REGION: in_region(regions, regions.names[int(regions.label(truth.position_mm))]),
        NO_REGION: NOTHING,
        TRUTH: near(truth.reshape(1), _AT_TRUTH[None]),
    }


def _outcome(at: RegistrationMap, seen: Seen, noise: Noise, name: str, belief: Belief, seed: int) -> Outcome:
    config = replace(FROM_POSE if name == TRUTH else RegisterConfig(), seed=seed)
    asked = {PREDICTION: COMPACT, REGIONS: COMPACT, HARD: COMPACT, TWO_LAYER_REGIONS: TWO_LAYER}.get(name)
    observation: Observation = seen.trial.observation(noise)
    begun = time.process_time()
    result = register(at, observation, belief, config)
    spent = time.process_time() - begun + (seen.cpu_s[asked] if asked else 0.0)
    return _judged(at.anatomy, seen.trial, result.best, result.status == "registered", spent)


def _by_others(
    at: RegistrationMap, seen: Seen, noise: Noise, belief: Belief, others: Mapping[str, Solver]
) -> dict[str, Outcome]:
    observation, found = seen.trial.observation(noise), {}
    for name, solver in others.items():
        begun = time.process_time()
        answer = solver(at, observation, belief)
        spent = time.process_time() - begun - answer.judging_s + seen.cpu_s[COMPACT]
        found[name] = _judged(at.anatomy, seen.trial, answer.pose, True, spent)
    return found


def _judged(anatomy: Anatomy, trial: Trial, pose: Pose, accepted: bool, cpu_s: float) -> Outcome:
    """A pose beside the truth, by the wall ahead and by the landmarks."""
    truth, landmarks = trial.anatomy_T_camera, anatomy.landmarks_mm
    wall_mm = wall_ahead_mm(truth, trial.ranges["a"], trial.rays)
    off = target_errors_mm(pose, truth, np.stack(list(landmarks.values()))).mean() if landmarks else None
    return Outcome(
        float(target_errors_mm(pose, truth, wall_mm).mean()), None if off is None else float(off), accepted, cpu_s
    )
