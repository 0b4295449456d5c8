"""The published experiment in small, on a winding tube: every stage runs, goes on, and refuses what is another's."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from naris.anatomy.folder import load_anatomy
from naris.anatomy.regions import PAPER_SLABS
from naris.bench.extract import reproduce_figures
from naris.dataset.splits import SplitSizes
from naris.errors import ConfigurationChanged, InputError
from naris.experiment.sets import PUBLISHED, TRAJECTORY
from naris.report import words
from naris.report.data import ReportData
from naris.report.write import write_report
from naris.reproduce import ReproduceConfig, repeats_the_published, reproduce
from tests.winding_tube import winding_tube

SMALL = ReproduceConfig(
    sizes=SplitSizes(train_positions=12, test_positions=4, per_position=2),
    epochs=1,
    runs=2,
    compact_epochs=1,
    compact_runs=1,
    at_will_steps=3,
    workers=1,
)


@pytest.fixture(scope="module")
def texture(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("texture") / "texture.png"
    picture = np.random.default_rng(0).integers(60, 200, (40, 50, 3), dtype=np.uint8)
    cv2.imwrite(str(path), picture)
    return path


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("experiment") / "out"


@pytest.fixture(scope="module")
def found(folder: Path, texture: Path) -> ReportData:
    return reproduce(winding_tube(), texture, folder, SMALL)


def test_every_network_is_tested_on_every_split(found: ReportData) -> None:
    assert [network.key for network in found.networks] == ["two_layer", "compact", "compact_at_will"]
    for network in found.networks:
        assert [test.split for test in network.tests] == [split.key for split in found.splits]
        for test in network.tests:
            assert all(run.count == 8 for run in test.runs)
            assert test.interval is not None and test.interval[0] <= test.mean <= test.interval[1]
    assert [len(network.training) for network in found.networks] == [2, 1, 1]


def test_the_published_split_leaks_and_the_others_do_not(found: ReportData) -> None:
    published, trajectory = found.split(PUBLISHED), found.split(TRAJECTORY)
    assert published.nearest_mm is not None and (published.nearest_mm <= 1.0 + 1e-9).all()
    assert trajectory.nearest_mm is not None and trajectory.nearest_deg is not None
    assert ((trajectory.nearest_mm >= 2) | (trajectory.nearest_deg >= 15)).all()


def test_only_networks_with_a_pose_head_have_pose_errors(found: ReportData) -> None:
    with_pose = {network.key: network.tests[0].pose is not None for network in found.networks}
    assert with_pose == {"two_layer": False, "compact": True, "compact_at_will": True}


def test_the_figures_have_the_names_of_the_documents(found: ReportData) -> None:
    names = {figure.name for figure in reproduce_figures(found)}
    wanted = {
        f"reproduce.{network}.{split}.{what}"
        for network in ("two_layer", "compact")
        for split in ("published", "trajectory", "trajectory_texture")
        for what in ("accuracy", "nonneighbour_error")
    }
    assert wanted | {"reproduce.compact.at_will.accuracy"} <= names


def test_the_report_is_written(found: ReportData, tmp_path: Path) -> None:
    text = write_report(found, tmp_path / "report.html").read_text(encoding="utf-8")
    assert "winding tube" in text and "<svg" in text


def test_a_second_run_makes_nothing_anew(found: ReportData, folder: Path, texture: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}
    again = reproduce(winding_tube(), texture, folder, SMALL)
    after = {path: path.stat().st_mtime_ns for path in folder.rglob("*") if path.is_file()}
    assert after == before
    for a, b in zip(found.networks, again.networks, strict=True):
        assert [test.mean for test in a.tests] == [test.mean for test in b.tests]


def test_another_experiment_is_refused(found: ReportData, folder: Path, texture: Path) -> None:
    longer = ReproduceConfig(sizes=SMALL.sizes, epochs=2, runs=2, compact_epochs=1, compact_runs=1, at_will_steps=3)
    with pytest.raises(ConfigurationChanged, match="other settings"):
        reproduce(winding_tube(), texture, folder, longer)


def test_the_times_are_those_of_the_first_run(found: ReportData, folder: Path, texture: Path) -> None:
    again = reproduce(winding_tube(), texture, folder, SMALL)
    assert again.stages == found.stages
    names = [stage.name for stage in found.stages]
    assert names == ["pictures", *(f"train: {network.label}" for network in found.networks), "evaluate"]
    told = {figure.name: figure.value for figure in reproduce_figures(again)}
    two_layer = found.networks[0]
    assert told["reproduce.two_layer.training_seconds"] == found.stages[1].wall_s
    # One after the other: the stage takes at least what the runs take together.
    assert found.stages[1].wall_s is not None
    assert found.stages[1].wall_s >= sum(curve.wall_s for curve in two_layer.training) - 0.01


def test_an_unknown_time_is_left_out(found: ReportData, tmp_path: Path) -> None:
    stages = tuple(replace(stage, wall_s=None, cpu_s=None) for stage in found.stages)
    names = {figure.name for figure in reproduce_figures(replace(found, stages=stages))}
    assert not any(name.endswith("training_seconds") for name in names)
    assert "not known" in write_report(replace(found, stages=stages), tmp_path / "r.html").read_text(encoding="utf-8")


def test_another_nose_is_not_compared_with_the_published_figure(found: ReportData) -> None:
    assert found.published is None
    assert found.networks[0].label == "two-layer, fixed pictures"
    assert "as published" not in (found.anatomy.texture or "")
    said = " ".join(words.done(found))
    assert "modelled on the experiment of Sinha" in said
    assert "repeats" not in said
    assert not any(figure.peers for figure in reproduce_figures(found))


def test_only_the_published_experiment_is_compared(mean_nose_ply: Path, mean_nose_texture: Path, texture: Path) -> None:
    nose = load_anatomy(str(mean_nose_ply))
    assert repeats_the_published(nose, mean_nose_texture, ReproduceConfig(compact_epochs=1, workers=1, seed=3))
    assert not repeats_the_published(winding_tube(), mean_nose_texture, ReproduceConfig())
    assert not repeats_the_published(nose, texture, ReproduceConfig())
    other = replace(PAPER_SLABS, name="mine", borders_mm=(-20.0, -10.0, 0.0))
    assert not repeats_the_published(nose.with_(regions={"mine": other}), mean_nose_texture, ReproduceConfig())
    for less in (ReproduceConfig(epochs=29), ReproduceConfig(runs=1), ReproduceConfig(sizes=SMALL.sizes)):
        assert not repeats_the_published(nose, mean_nose_texture, less)


def test_no_runs_are_refused() -> None:
    with pytest.raises(InputError, match="one run"):
        ReproduceConfig(runs=0)
