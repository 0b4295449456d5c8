"""Figures of a report have the names and values that documents quote."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from naris.bench.extract import demo_figures, reproduce_figures
from naris.report import ReportData


def made_by_the_report_tests() -> ModuleType:
    path = Path(__file__).parents[1] / "report" / "conftest.py"
    spec = importlib.util.spec_from_file_location("made_by_the_report_tests", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def data() -> ReportData:
    made = made_by_the_report_tests()
    return made.make_reproduce(made.tube(), made.images(np.random.default_rng(5), 16, 32))


def test_names_are_those_of_the_documents(data: ReportData) -> None:
    figures = {figure.name: figure for figure in reproduce_figures(data)}
    expected = {
        f"reproduce.{network}.{split}.{what}"
        for network in ("two_layer", "compact")
        for split in ("published", "trajectory", "trajectory_texture")
        for what in ("accuracy", "nonneighbour_error", "ece")
    }
    expected |= {name.replace(".ece", ".accuracy_std") for name in expected if name.endswith(".ece")}
    expected |= {f"reproduce.compact.at_will.{what}" for what in ("accuracy", "nonneighbour_error", "ece")}
    expected.add("reproduce.two_layer.training_seconds")  # the only training among the stages
    assert figures.keys() == expected
    assert figures["reproduce.two_layer.training_seconds"].goal == 45 * 60
    assert figures["reproduce.two_layer.training_seconds"].value == 2400.0
    assert figures["reproduce.compact.trajectory.accuracy"].goal == 0.5
    assert figures["reproduce.compact.at_will.accuracy"].goal == 0.93
    assert figures["reproduce.two_layer.published.accuracy"].peers == {"published": 0.7653}
    assert figures["reproduce.two_layer.trajectory.accuracy"].peers == {}


def test_values_are_those_of_the_runs(data: ReportData) -> None:
    figures = {figure.name: figure for figure in reproduce_figures(data)}
    test = data.networks[0].tests[1]
    figure = figures["reproduce.two_layer.trajectory.accuracy"]
    assert figure.value == pytest.approx(np.mean([np.trace(run.confusion) / 150 for run in test.runs]))
    assert figure.n == 5 * 150
    assert figure.interval == test.interval
    assert figures["reproduce.two_layer.trajectory.nonneighbour_error"].n == round(750 * (1 - test.mean))


def test_without_wrong_answers_their_share_has_no_value(data: ReportData) -> None:
    test = data.networks[0].tests[0]
    right = replace(test, runs=(replace(test.runs[0], confusion=np.diag([3, 4, 5, 6])),))
    figures = reproduce_figures(replace(data, networks=(replace(data.networks[0], tests=(right,)),)))
    (far,) = (figure for figure in figures if figure.name == "reproduce.two_layer.published.nonneighbour_error")
    assert (far.value, far.n) == (None, 0)


def test_demo(data: ReportData) -> None:
    figures = {figure.name: figure for figure in demo_figures(data, 123.0)}
    assert figures["demo.seconds"].value == 123.0
    assert figures["demo.seconds"].goal == 300
    assert figures["demo.region_accuracy"].value == data.networks[0].tests[-1].mean
    assert figures["demo.region_accuracy"].goal == 0.85
    assert figures["demo.training_pictures"].value == data.networks[0].pictures


def test_a_demo_whose_time_nobody_knows_has_none(data: ReportData) -> None:
    names = [figure.name for figure in demo_figures(data, None)]
    assert "demo.region_accuracy" in names
    assert "demo.seconds" not in names
