"""The chain, frame in and pose out: is such a classification accurate enough to start a registration?

For each patient a network learns its nose in minutes, looks at frames from places that it has not seen, and what it
says starts a registration of the depth there, which is as wrong as that of `naris.bench.trials` (b, c). A frame counts
as right if its pose was not refused and puts the wall ahead within 2 mm, the mean target registration error
(`naris.core.targets`): the wall around the optical axis, as that is where somebody works; landmarks, most of them
far from the tip, stand beside it. Shares are of all frames; a refusal is a failure. Other solvers are told what the
network says too (`naris.bench.in_our_place`).
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from naris.bench import BenchRequest, Measurement
from naris.bench.anatomy import HEAD, LABELLED
from naris.bench.chain_patient import (
    BELIEFS,
    CHAIN_NOISES,
    COMPACT,
    PREDICTION,
    SAME_STARTS,
    TRUE_REGION,
    TRUTH,
    TWO_LAYER,
    ChainConfig,
    Patient,
    is_learned,
    learn,
    measured,
)
from naris.bench.chain_record import FrameRecord, Outcome, PatientRecord
from naris.bench.register import of_which_solver
from naris.bench.result import Figure, wilson
from naris.core.provenance import commit, file_digest, plain
from naris.core.side_by_side import side_by_side
from naris.experiment.claim import claim
from naris.register.libraries import LIBRARIES, missing
from naris.train import COMPACT_DEMO

VIRTUAL = 20
SCANS = {"p001": LABELLED, "ct-head": HEAD}
QUICK = ChainConfig(fit_steps=20, two_layer_steps=2, views=2)
"""Everything once, in small: it shows that the chain runs, its figures mean nothing."""

GOALS = {"b": 0.82, "c": 0.65}
AT_ONCE = 2
"""Patients whose networks learn at a time, before all frames: a network learns on half of the cores and leaves most of
the rest idle. Frames come one by one, so that nothing disturbs their CPU seconds; those of the networks are more than
of one alone, where cores share their units."""
FIT_GOAL_S = 360.0
"""CPU seconds: three minutes of two cores."""

RIGHT_MM, CLOSE_MM = 2.0, 1.0
LOST = ("doubt", "depth", "belief", "search")
"""Why a frame has no right pose, the first that holds: the most likely pose was right and was refused; a registration
that starts at the truth leaves it; with the true region it would have been right; it would not."""

Frames = Sequence[FrameRecord]


def measure(request: BenchRequest) -> Measurement:
    """All patients, or what is still missing of them in the folder `--work`.

    Raises:
        InputError: if the folder holds something else.
        ConfigurationChanged: if it holds a chain with other settings.
    """
    config = replace(QUICK if request.quick else ChainConfig(), seed=request.seed)
    if request.fit_steps is not None:
        config = replace(config, fit_steps=request.fit_steps)
    patients = chosen(request)
    with tempfile.TemporaryDirectory(prefix="naris-bench-chain-") as spare:
        out = request.work or Path(spare)
        claim(out, {"experiment": "chain", "config": plain(config)})
        unlearned = [patient for patient in patients if not is_learned(patient, config, out / patient.key)]
        if len(unlearned) > 1:
            jobs = [partial(learn, patient, config, out / patient.key) for patient in unlearned]
            side_by_side(jobs, AT_ONCE, request.progress)
        records = []
        with request.progress.task("patients", len(patients)) as advance:
            for patient in patients:
                records.append(measured(patient, config, out / patient.key, request.progress))
                advance(1)
    learned = (
        f"{config.fit_steps:,} batches of {COMPACT_DEMO.batch} views, the two-layer one {config.two_layer_steps:,}"
    )
    return Measurement(tuple(figures(records)), {**inputs(records, request), "each network learned from": learned})


def chosen(request: BenchRequest) -> list[Patient]:
    """Those that are asked for, real scans first as they are the fewest."""
    count = 1 if request.quick else VIRTUAL
    virtual = [Patient(f"virtual-{number:02d}", number) for number in range(min(request.patients or count, VIRTUAL))]
    if request.scans is None or request.quick:
        return virtual
    found = {key: request.scans / name for key, name in SCANS.items() if (request.scans / name).is_file()}
    return [*(Patient(key, VIRTUAL + list(SCANS).index(key), scan) for key, scan in found.items()), *virtual]


def figures(records: Sequence[PatientRecord]) -> list[Figure]:
    """Of all frames of all patients; of virtual and real ones apart too, where there are both."""
    base, n = "register.chain", len(records)
    all_frames = [frame for record in records for frame in record.frames]
    frame_count = len(all_frames)
    spent = {name: float(np.mean([getattr(record.fit, name) for record in records])) for name in ("cpu_s", "wall_s")}
    made = [
        Figure(f"{base}.patients", float(n), "patients", n, "higher", float(VIRTUAL + len(SCANS))),
        Figure(f"{base}.fit.cpu_s", spent["cpu_s"], "CPU-s", n, "lower", FIT_GOAL_S),
        Figure(f"{base}.fit.wall_s", spent["wall_s"], "s", n, "lower"),
        *(
            _share(f"{base}.{name}.region_accuracy", (frame.said[name] == frame.region for frame in all_frames))
            for name in (COMPACT, TWO_LAYER)
        ),
        Figure(f"{base}.pose_median_mm", float(np.median([f.pose_mm for f in all_frames])), "mm", frame_count, "lower"),
    ]
    for noise in CHAIN_NOISES:
        for belief in BELIEFS:
            made += _of_belief(base, noise, belief, all_frames)
        made += _of_lost(f"{base}.{noise}", noise, all_frames)
        for name in SAME_STARTS:
            made += _of_other(f"{base}.{noise}", noise, name, all_frames)
    real = [record for record in records if record.real]
    if real and len(real) < n:
        for kind, some in (("scans", real), ("virtual", [record for record in records if not record.real])):
            made += _apart(f"{base}.{kind}", [frame for record in some for frame in record.frames])
    return made


def inputs(records: Sequence[PatientRecord], request: BenchRequest) -> dict[str, str]:
    """Who was measured, and by which code, where it was not this one."""
    virtual = sum(not record.real for record in records)
    told = {
        "confidence": of_which_solver(),
        "patients": f"{virtual} of {VIRTUAL} virtual patients, {len(records) - virtual} of {len(SCANS)} real scans",
        **{record.key: f"{record.anatomy}, {len(record.frames)} frames" for record in records},
    }
    for name in SCANS.values():
        if request.scans is not None and (request.scans / name).is_file() and len(records) > virtual:
            told[name.name] = f"SHA-256 {file_digest(request.scans / name)}"
    here = commit()
    for record in records:
        others = sorted({str(frame.commit) for frame in record.frames} - {str(here)})
        if others:
            told[f"{record.key}, measured by"] = ", ".join(others)
    return told


def right(outcome: Outcome) -> bool:
    """Whether the most likely pose, refused or not, puts the wall ahead where it is."""
    return outcome.wall_mm < RIGHT_MM


def lost(of_noise: Mapping[str, Outcome]) -> str | None:
    """Why there is no right pose (`LOST`); None where there is one."""
    given = of_noise[PREDICTION]
    if right(given):
        return None if given.accepted else "doubt"
    if not right(of_noise[TRUTH]):
        return "depth"
    return "belief" if right(of_noise[TRUE_REGION]) else "search"


def _of_belief(base: str, noise: str, belief: str, some: Frames) -> list[Figure]:
    is_main = belief == PREDICTION
    name = f"{base}.{noise}" if is_main else f"{base}.{noise}.{belief}"
    found = [frame.found[noise][belief] for frame in some]
    goal = GOALS[noise] if is_main else None
    marks = [one.landmarks_mm for one in found if one.landmarks_mm is not None]
    made = [
        _share(f"{name}.tre_lt1", (one.accepted and one.wall_mm < CLOSE_MM for one in found)),
        _share(f"{name}.tre_lt2", (one.accepted and right(one) for one in found), goal),
        Figure(f"{name}.tre_median_mm", float(np.median([one.wall_mm for one in found])), "mm", len(found), "lower"),
        _share(f"{name}.refused", (not one.accepted for one in found), better_lower=True),
        _share(f"{name}.accepted_wrong", (one.accepted and not right(one) for one in found), better_lower=True),
        _share(f"{name}.likeliest_lt2", map(right, found)),
        Figure(f"{name}.cpu_s", float(np.mean([one.cpu_s for one in found])), "CPU-s", len(found), "lower"),
    ]
    if is_main and marks:
        both = (one.accepted and one.landmarks_mm is not None and one.landmarks_mm < RIGHT_MM for one in found)
        made.insert(2, _share(f"{name}.landmarks_lt2", both))
    return made


def _of_other(name: str, noise: str, solver: str, some: Frames) -> list[Figure]:
    """Of a solver from the same starts as the others, which refuses nothing; ours is among them."""
    found = [frame.by_others[noise][solver] for frame in some if solver in frame.by_others[noise]]
    name = f"{name}.by_{solver.lower()}"
    if not found:
        why = missing(solver) if solver in LIBRARIES else None
        told = {solver: why or "not measured"}
        return [Figure(f"{name}.tre_lt2", None, "1", 0, "higher", peers=told)]
    spent = float(np.mean([one.cpu_s for one in found]))
    return [
        _share(f"{name}.tre_lt1", (one.wall_mm < CLOSE_MM for one in found)),
        _share(f"{name}.tre_lt2", map(right, found)),
        Figure(f"{name}.cpu_s", spent, "CPU-s", len(found), "lower"),
    ]


def _of_lost(name: str, noise: str, some: Frames) -> list[Figure]:
    why = [lost(frame.found[noise]) for frame in some]
    return [_share(f"{name}.lost.{kind}", (one == kind for one in why), better_lower=True) for kind in LOST]


def _apart(name: str, some: Frames) -> list[Figure]:
    made = [_share(f"{name}.region_accuracy", (frame.said[COMPACT] == frame.region for frame in some))]
    for noise in CHAIN_NOISES:
        found = [frame.found[noise][PREDICTION] for frame in some]
        made.append(_share(f"{name}.{noise}.tre_lt2", (one.accepted and right(one) for one in found)))
        made.append(_share(f"{name}.{noise}.refused", (not one.accepted for one in found), better_lower=True))
    return made


def _share(name: str, each: Iterable[bool], goal: float | None = None, *, better_lower: bool = False) -> Figure:
    """Of all frames. The interval takes them for independent; those of a patient share its network."""
    listed = [bool(one) for one in each]
    n, yes = len(listed), sum(listed)
    return Figure(name, yes / n, "1", n, "lower" if better_lower else "higher", goal, wilson(yes, n))
