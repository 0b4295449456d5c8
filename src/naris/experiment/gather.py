"""What an experiment found, put together for its report."""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from naris.core.pose import stack
from naris.core.progress import Progress
from naris.core.provenance import commit, machine, plain, versions
from naris.experiment.contenders import Contender
from naris.experiment.score import pose_errors
from naris.experiment.sets import TRAJECTORY_TEXTURE, Sets, Setting
from naris.experiment.splits import describe_splits, example_views, trajectory_lines
from naris.locate import is_localised
from naris.model.localizer import open_localizer
from naris.report.data import (
    AnatomyView,
    LocatedFrame,
    NetworkResult,
    Published,
    ReportData,
    TrainingCurve,
)
from naris.report.scores import TestResult


@dataclass(frozen=True, eq=False)
class Telling:
    """What the report says besides its figures.

    Attributes:
        kind: which command.
        title: of the page.
        command: as typed.
        texture: what coloured the walls of the training pictures, as a phrase.
        published: a figure to compare with.
    """

    kind: Literal["reproduce", "demo"]
    title: str
    command: str
    texture: str
    published: Published | None = None


def network_result(contender: Contender, tests: Sequence[TestResult]) -> NetworkResult:
    """A contender with its results."""
    plan, runs = contender.plan, contender.runs
    network = open_localizer(runs[0].checkpoint).network
    curves = tuple(TrainingCurve(run.seed, run.loss, run.wall_s, run.cpu_s) for run in runs)
    step = "epoch" if plan.config.epochs is not None else f"{runs[0].per_epoch} steps"
    return NetworkResult(
        key=plan.key,
        label=plan.label,
        description=plan.description,
        trained_on=plan.trained_on,
        parameters=sum(weight.numel() for weight in network.parameters()),
        training=curves,
        tests=tuple(tests),
        pictures=runs[0].pictures,
        step=step,
    )


def report_data(
    telling: Telling,
    setting: Setting,
    sets: Sets,
    networks: Sequence[NetworkResult],
    located: Sequence[LocatedFrame],
) -> ReportData:
    """Everything that the page needs, but for the stages: this belongs to the last of them."""
    anatomy = setting.scene.anatomy
    return ReportData(
        kind=telling.kind,
        title=telling.title,
        command=telling.command,
        made=datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        anatomy=AnatomyView(anatomy, setting.regions.name, telling.texture, trajectory_lines(sets)),
        splits=describe_splits(sets),
        networks=tuple(networks),
        views=example_views(sets),
        located=tuple(located),
        published=telling.published,
        settings=_settings(setting, networks),
        machine=machine(),
        versions=versions(),
        commit=commit(),
        seed=setting.seed,
    )


def _settings(setting: Setting, networks: Sequence[NetworkResult]) -> dict[str, dict[str, Any]]:
    seen = setting.seen
    return {
        "pictures": {
            "width": setting.intrinsics.width,
            "height": setting.intrinsics.height,
            "vertical field of view, degrees": round(setting.intrinsics.vertical_fov_deg, 3),
            **plain(setting.sizes),
        },
        "training appearance": {"kind": type(seen).__name__, **plain(seen)},
        "unseen appearance": plain(setting.unseen),
        "networks": {network.label: network.trained_on for network in networks},
    }


def locate_some(contender: Contender, sets: Sets, count: int, seed: int, progress: Progress) -> list[LocatedFrame]:
    """Ask the first run of a contender about test pictures under unseen looks, one region after the other."""
    pictures = sets.tests[TRAJECTORY_TEXTURE]
    rng = np.random.default_rng([seed, len(pictures)])
    by_region = [np.flatnonzero(pictures.labels == k) for k in range(len(pictures.regions.names))]
    mixed = [rng.permutation(of_region) for of_region in by_region]
    chosen = [int(mixed[i % len(mixed)][i // len(mixed)]) for i in range(count)]
    images = pictures.images(chosen)
    with progress.task("locate", count) as advance:
        predictions = open_localizer(contender.checkpoints[0]).predict(images)
        advance(count)
    best = [prediction.hypotheses for prediction in predictions if prediction.hypotheses is not None]
    truth = pictures.anatomy_T_camera[np.array(chosen)]
    errors = pose_errors(stack(best), truth) if len(best) == count else None
    return [
        LocatedFrame(
            name=pictures.image_files[i].name,
            image=images[k],
            prediction=predictions[k],
            localised=is_localised(predictions[k]),
            truth=int(pictures.labels[i]),
            position_error_mm=None if errors is None else float(errors.position_mm[k]),
            rotation_error_deg=None if errors is None else float(errors.rotation_deg[k]),
        )
        for k, i in enumerate(chosen)
    ]
