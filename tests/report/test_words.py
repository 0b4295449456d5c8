"""The sentences follow the numbers."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from naris.report import SINHA_2018, Calibration, ReportData, RunScore, TestResult, TrainingCurve, words


def result(split: str, accuracy: float, runs: int = 2) -> TestResult:
    """A test of 1,000 pictures per run, right in exactly that share, chance 25 %."""
    right = round(250 * accuracy)
    confusion = np.full((4, 4), 0)
    np.fill_diagonal(confusion, right)
    confusion[[0, 1, 2, 3], [1, 0, 3, 2]] = 250 - right
    return TestResult(split, tuple(RunScore(i, confusion) for i in range(runs)))


def with_accuracies(data: ReportData, **accuracies: float) -> ReportData:
    network = replace(data.networks[0], tests=tuple(result(split, a) for split, a in accuracies.items()))
    return replace(data, networks=(network,))


def test_a_fall_is_called_interpolation(reproduce_data: ReportData) -> None:
    data = with_accuracies(reproduce_data, published=0.88, trajectory=0.28)
    (said,) = words.leak(data)
    assert "interpolation" in said
    assert "88.0" in said
    assert "28.0" in said
    assert "median test view stands" in said
    assert "interpolates" in words.lede(data)


def test_no_fall_is_not(reproduce_data: ReportData) -> None:
    data = with_accuracies(reproduce_data, published=0.88, trajectory=0.84)
    (said,) = words.leak(data)
    assert "little of its figure rests on near-duplicate" in said
    assert "interpolates" not in words.lede(data)


def test_a_rise_is_called_odd(reproduce_data: ReportData) -> None:
    (said,) = words.leak(with_accuracies(reproduce_data, published=0.5, trajectory=0.84))
    assert "odd" in said


def test_leak_needs_both_splits(reproduce_data: ReportData) -> None:
    assert words.leak(with_accuracies(reproduce_data, trajectory=0.8)) == []


@pytest.mark.parametrize(("accuracy", "expected"), [(0.772, "in line with"), (0.88, "above"), (0.6, "below")])
def test_against_published(accuracy: float, expected: str) -> None:
    assert words.against_published(result("published", accuracy), SINHA_2018) == expected


def test_chance_is_named(reproduce_data: ReportData) -> None:
    data = with_accuracies(reproduce_data, published=0.88, trajectory=0.28)
    assert any("no better than that" in said for said in words.came_out(data))
    data = with_accuracies(reproduce_data, published=0.88, trajectory=0.6)
    assert not any("no better than that" in said for said in words.came_out(data))


def test_wrong_answers_are_spoken_of_where_there_are_some(reproduce_data: ReportData) -> None:
    data = with_accuracies(reproduce_data, published=1.0, trajectory=0.6)
    assert any(said.startswith("Of the wrong answers, 0.0\u00a0%") for said in words.came_out(data))
    none = with_accuracies(reproduce_data, published=1.0, trajectory=1.0)
    assert not any("wrong answers" in said for said in words.came_out(none))


def test_what_was_published_is_named_where_a_split_is_called_so(
    reproduce_data: ReportData, bare_data: ReportData
) -> None:
    demo = replace(reproduce_data, kind="demo", published=None)
    assert sum(SINHA_2018.citation in said for said in words.done(demo)) == 1
    assert not any(SINHA_2018.citation in said for said in words.done(bare_data))


def test_training_pictures_say_nothing_of_a_network_that_never_saw_them(reproduce_data: ReportData) -> None:
    fixed = with_accuracies(reproduce_data, published=0.9, trajectory=0.86).networks[0]
    at_will = replace(fixed, key="compact_at_will")
    first, second = words.leak(replace(reproduce_data, networks=(at_will, fixed)))
    assert "a training view" not in first
    assert "a training view" in second
    large = with_accuracies(reproduce_data, published=1.0, trajectory=0.86).networks[0]
    first, second = words.leak(replace(reproduce_data, networks=(replace(large, key="compact_at_will"), large)))
    assert "near-duplicate" not in first
    assert "measures interpolation between near-duplicate views" in second


def test_one_value_is_no_curve(reproduce_data: ReportData) -> None:
    network = reproduce_data.networks[0]
    assert words.short_training(network) is None
    short = replace(network, training=(TrainingCurve(0, np.array([0.7612]), 1.0, 1.0),))
    assert "one value only (0.761)" in (words.short_training(short) or "")


@pytest.mark.parametrize(
    ("confidence", "expected"), [(0.95, "Too sure"), (0.2, "Less sure"), (0.52, "close to the share of right answers")]
)
def test_calibration_is_told(reproduce_data: ReportData, confidence: float, expected: str) -> None:
    known = Calibration(np.array([confidence]), np.array([0.5]), np.array([1000]))
    test = result("trajectory", 0.5)
    test = replace(test, runs=tuple(replace(run, calibration=known) for run in test.runs))
    data = replace(reproduce_data, networks=(replace(reproduce_data.networks[0], tests=(test,)),))
    (said,) = words.calibration(data)
    assert expected in said


def test_no_number_is_typed_in(reproduce_data: ReportData, bare_data: ReportData) -> None:
    """Without networks nothing may be claimed about accuracy."""
    said = " ".join([*words.came_out(replace(bare_data, networks=())), words.lede(replace(bare_data, networks=()))])
    assert "%" not in said


def test_numbers_as_people_say_them() -> None:
    assert words.seconds(3.21) == "3.2\u00a0s"
    assert words.seconds(75) == "75\u00a0s"
    assert words.seconds(2520) == "42\u00a0min"
    assert words.seconds(7200) == "2.0\u00a0h"
    assert words.spread(0.7653, 0.0119) == "76.5\u00a0±\u00a01.2\u00a0%"
    assert words.listed(["a", "b", "c"]) == "a, b and c"
    assert words.reach([0.1, 0.1]) == "10.0\u00a0%"
    assert words.counted(3) == "three"
    assert words.counted(1420) == "1,420"


def test_labels_become_phrases(reproduce_data: ReportData) -> None:
    network = replace(reproduce_data.networks[0], phrase=None)
    assert replace(network, label="compact").called == "the compact network"
    assert replace(network, label="compact, views at will").called == "the compact network (views at will)"
    assert replace(network, phrase="ours").called == "ours"


def test_the_hardest_test_is_spoken_of(reproduce_data: ReportData) -> None:
    first, second, _ = reproduce_data.networks
    assert [test.split for test in words.main_tests(reproduce_data, first)] == [
        "published",
        "trajectory",
        "trajectory_texture",
    ]
    assert [test.split for test in words.main_tests(reproduce_data, second)] == ["trajectory_texture"]
