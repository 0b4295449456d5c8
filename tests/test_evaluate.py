"""Figures of predictions whose right values are known by construction, or counted in the plainest way."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from naris.core.anatomy import SlabRegions
from naris.core.camera import Intrinsics
from naris.core.pose import Pose, fingerprints
from naris.dataset.layout import RegionLabels
from naris.dataset.pictures import encode_rgb
from naris.dataset.read import Dataset
from naris.errors import DatasetError, RegionError
from naris.evaluate import Said, export, read_said, score, summary
from naris.evaluate.score import bootstrap, normalised_square
from naris.model.calibration import Calibration
from naris.model.checkpoint import Checkpoint, Subject
from naris.model.compact import CompactConfig
from naris.model.localizer import build, config_json, open_localizer, weights_of
from naris.render.viewpoints import Viewpoints

SLABS = SlabRegions("paper", ("a", "b", "c", "d"), "mean", 1, (-30.0, -15.0, 0.0))
LABELS = RegionLabels.of(SLABS)


def _said(n: int = 400, sure: float = 0.8, seed: int = 0, per_position: int = 10) -> Said:
    """Answers that are right with the very probability that they state, positions of near-copies, known pose errors."""
    rng = np.random.default_rng(seed)
    truth = rng.integers(0, 4, n)
    p = np.full((n, 4), (1 - sure) / 3)
    answer = np.where(rng.random(n) < sure, truth, (truth + rng.integers(1, 4, n)) % 4)
    p[np.arange(n), answer] = sure
    pose = Pose.of(Rotation.random(n, rng=rng).as_matrix(), rng.normal(size=(n, 3)) * 20, "mean", "camera")
    deviation = np.array([1.0, 1.0, 3.0, 0.05, 0.05, 0.1])
    twist = rng.normal(size=(n, 2, 6)) * deviation * [[[1.0], [4.0]]]
    guess = np.stack([(pose @ Pose.exp(twist[:, m], "camera", "camera").inverse()).matrix for m in range(2)], axis=1)
    position = np.arange(n) // per_position
    covariance = np.tile(np.diag(deviation**2), (n, 2, 1, 1))
    return Said(
        LABELS,
        np.log(p),
        truth,
        pose,
        position,
        position // 4,
        (np.arange(n) % 4 == 0) * 0.9,
        Pose(guess, "mean", "camera"),
        np.tile([0.7, 0.3], (n, 1)),
        covariance,
        seed,
        "x",
    )


def test_accuracy_confusion_and_neighbours_agree_with_counting() -> None:
    said = _said()
    found = score(said)
    counts = np.zeros((4, 4), int)
    far = wrong = 0
    for truth, p in zip(said.region.tolist(), said.log_probabilities, strict=True):
        answer = int(np.argmax(p))
        counts[truth][answer] += 1
        wrong += answer != truth
        far += abs(answer - truth) > 1
    assert np.array_equal(found.confusion, counts)
    assert found.accuracy == pytest.approx(1 - wrong / 400)
    assert found.nonneighbour_error == pytest.approx(far / wrong)
    assert found.refused == 0.25
    assert (found.pictures, found.clusters) == (400, 40)


def test_a_perfect_run_has_no_error_to_share() -> None:
    said = _said()
    right = np.full((400, 4), -9.0)
    right[np.arange(400), said.region] = 0.0
    found = score(replace(said, log_probabilities=right - np.log(np.exp(right).sum(axis=1, keepdims=True))))
    assert (found.accuracy, found.nonneighbour_error, found.interval) == (1.0, None, (1.0, 1.0))


def test_honest_probabilities_have_no_calibration_error_and_boasting_has_its_gap() -> None:
    honest = score(_said(40_000)).reliability
    assert honest.ece < 0.01
    said = _said(40_000)
    boast = np.where(said.log_probabilities == said.log_probabilities.max(axis=1, keepdims=True), 0.97, 0.01)
    assert score(replace(said, log_probabilities=np.log(boast))).reliability.ece == pytest.approx(0.17, abs=0.01)
    assert honest.count.sum() == 40_000


def test_pose_errors_are_those_that_were_made() -> None:
    pose = score(_said(4000)).pose
    rng = np.random.default_rng(1)
    shift = np.linalg.norm(rng.normal(size=(200_000, 3)) * [1, 1, 3], axis=1)
    turn = np.rad2deg(np.linalg.norm(rng.normal(size=(200_000, 3)) * [0.05, 0.05, 0.1], axis=1))
    assert pose.median_mm == pytest.approx(np.median(shift), rel=0.05)
    assert pose.p90_mm == pytest.approx(np.percentile(shift, 90), rel=0.05)
    assert pose.median_deg == pytest.approx(np.median(turn), rel=0.05)
    assert pose.near == pytest.approx(((shift <= 4) & (turn <= 15)).mean(), abs=0.02)
    assert pose.any_near > pose.near
    assert pose.in_claim == pytest.approx(0.95, abs=0.02)


def test_a_boastful_covariance_is_found_out() -> None:
    said = _said(4000)
    assert score(replace(said, covariance=said.covariance / 9)).pose.in_claim < 0.5
    assert score(replace(said, covariance=None)).pose.in_claim is None
    assert score(replace(said, hypotheses=None)).pose is None


def test_the_bootstrap_knows_that_copies_tell_nothing_new() -> None:
    """Clusters of identical answers: the interval is that of the clusters, not of the pictures."""
    rng = np.random.default_rng(0)
    right = rng.random(200) < 0.7
    copies, cluster = np.repeat(right, 10), np.repeat(np.arange(200), 10)
    low, high = bootstrap(copies[None], cluster, np.random.default_rng(0))
    expected = 2 * 1.96 * np.sqrt(right.mean() * (1 - right.mean()) / 200)
    assert high - low == pytest.approx(expected, rel=0.1)
    naive_low, naive_high = bootstrap(copies[None], np.arange(2000), np.random.default_rng(0))
    assert naive_high - naive_low == pytest.approx(expected / np.sqrt(10), rel=0.1)


def test_the_interval_covers_the_truth_as_often_as_it_says() -> None:
    covered = 0
    for seed in range(200):
        rng = np.random.default_rng(seed)
        share = rng.beta(7, 3, 60)
        right = rng.random((60, 10)) < share[:, None]
        low, high = bootstrap(right.reshape(1, -1), np.repeat(np.arange(60), 10), rng)
        covered += low <= 0.7 <= high
    assert 0.88 <= covered / 200 <= 0.99


def test_larger_clusters_give_wider_intervals_and_free_views_their_own() -> None:
    said = _said()
    assert (score(said, by="position").clusters, score(said, by="trajectory").clusters) == (40, 10)
    free = replace(said, position=np.full(400, -1))
    assert score(free).clusters == 400


def test_several_runs() -> None:
    runs = [replace(_said(seed=0), seed=s) for s in range(3)]
    other = _said(seed=0).log_probabilities[:, [1, 0, 2, 3]]
    runs[2] = replace(runs[2], log_probabilities=other)
    found = summary(runs)
    accuracies = [one.accuracy for one in found.scores]
    assert found.mean == pytest.approx(np.mean(accuracies))
    assert found.std == pytest.approx(np.std(accuracies, ddof=1))
    assert found.interval[0] < found.mean < found.interval[1]
    assert summary(runs[:1]).std is None
    assert json.loads(json.dumps(found.to_json(), allow_nan=False))["scores"][0]["pose"]["in_claim"] > 0
    with pytest.raises(DatasetError, match="runs on the same pictures"):
        summary([runs[0], _said(seed=5)])
    with pytest.raises(DatasetError, match="runs on the same pictures"):
        summary([])


def _dataset(folder: Path, labels: RegionLabels = LABELS) -> Dataset:
    rng = np.random.default_rng(0)
    folder.mkdir(exist_ok=True)
    files = tuple(folder / f"{i:02d}.png" for i in range(12))
    for file in files:
        file.write_bytes(encode_rgb(rng.integers(0, 256, (32, 32, 3), dtype=np.uint8)))
    place = rng.uniform([-5, -40, -5], [5, 20, 5], (12, 3))
    pose = Pose.of(Rotation.random(12, rng=rng).as_matrix(), place, "mean", "camera")
    views = Viewpoints(pose, SLABS.label(place), np.arange(12) // 6, np.arange(12) // 3)
    camera = Intrinsics.from_vertical_fov(32, 32, 45.0)
    return Dataset(folder, camera, labels, views, files, None, 0.0, "mean nose", None, {})


def _checkpoint(seed: int) -> Checkpoint:
    config = CompactConfig(input_px=16, channels=(8, 16), blocks=(1, 1), reduced=4, embedding=12, hypotheses=2)
    torch.manual_seed(seed)
    subject = Subject(LABELS, "mean nose", None, "mean", Intrinsics.from_vertical_fov(16, 16, 45.0), SLABS)
    training = {"settings": {"seed": 5}}
    weights = weights_of(build(config, 4))
    return Checkpoint("compact", config_json(config), subject, weights, Calibration(1.5, 9, None, 0.7), training)


def test_export_is_what_the_localizer_says_and_is_read_the_second_time(tmp_path: Path) -> None:
    dataset, model, out = _dataset(tmp_path / "set"), _checkpoint(0), tmp_path / "said.npz"
    said = export(model, dataset, out)
    predictions = open_localizer(model).predict(dataset.images())
    assert np.allclose(said.log_probabilities, [p.log_probabilities for p in predictions])
    assert np.allclose(said.hypotheses.matrix, [p.hypotheses.matrix for p in predictions])
    assert said.seed == 5
    stamp = out.stat().st_mtime_ns
    again = export(model, dataset, out)
    assert out.stat().st_mtime_ns == stamp
    assert json.dumps(score(again).to_json()) == json.dumps(score(said).to_json())
    export(_checkpoint(1), dataset, out)
    assert out.stat().st_mtime_ns != stamp


def test_poses_are_compared_in_one_frame_and_one_anatomy_only(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    dataset, model = _dataset(tmp_path / "set"), _checkpoint(0)
    elsewhere = replace(model, subject=replace(model.subject, frame="patient", borders=None))
    with pytest.raises(DatasetError, match="in the frame 'patient' of the model, got poses in the frame 'mean'"):
        export(elsewhere, dataset, tmp_path / "said.npz")
    known = replace(model, subject=replace(model.subject, anatomy_digest="a" * 64))
    same, other = (replace(dataset, anatomy_digest=letter * 64) for letter in "ab")
    # An anatomy that nobody recorded is taken for the same.
    for comparable in (dataset, same):
        assert score(export(known, comparable, tmp_path / "said.npz")).pose is not None
    assert not caplog.records
    said = export(known, other, tmp_path / "said.npz")
    assert "another anatomy" in caplog.text
    assert score(said).pose is None
    assert np.array_equal(said.log_probabilities, export(known, same).log_probabilities)
    head_alone = replace(known, calibration=replace(known.calibration, power=0.0))
    assert not np.allclose(said.log_probabilities, export(head_alone, same).log_probabilities, atol=1e-3)
    assert score(export(known, other, tmp_path / "said.npz")).pose is None


def test_a_model_of_other_regions_and_a_broken_export_are_told(tmp_path: Path) -> None:
    other = RegionLabels("halves", ("front", "back"), np.ones((2, 2), dtype=bool))
    with pytest.raises(RegionError, match="made for the 4 of 'paper'"):
        export(_checkpoint(0), _dataset(tmp_path / "set", other))
    path = tmp_path / "said.npz"
    export(_checkpoint(0), _dataset(tmp_path / "set"), path)
    whole = path.read_bytes()
    for content in (whole[: len(whole) // 2], b"", b"text"):
        path.write_bytes(content)
        with pytest.raises(DatasetError, match="exported predictions"):
            read_said(path)
    np.savez(path, about=np.array([{"a": object}], dtype=object))
    with pytest.raises(DatasetError, match="exported predictions"):
        read_said(path)


def test_pictures_that_a_model_learned_from_are_told(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    dataset, model = _dataset(tmp_path / "set"), _checkpoint(0)
    views = fingerprints(dataset.anatomy_T_camera[:5])
    export(replace(model, training={"data": {"kind": "data set", "views": views}}), dataset)
    assert "5 of the 12 pictures stand at poses that the model learned from" in caplog.text
    caplog.clear()
    other = dataset.anatomy_T_camera @ Pose.of(np.eye(3), np.array([0.01, 0, 0]), "camera", "camera")
    export(replace(model, training={"data": {"kind": "data set", "views": fingerprints(other)}}), dataset)
    assert not caplog.records


def test_errors_as_large_as_their_covariance_says_come_to_one() -> None:
    rng = np.random.default_rng(0)
    root = rng.standard_normal((6, 6)) * np.array([0.3, 0.3, 0.3, 0.02, 0.02, 0.02])[:, None]
    truth = Pose.exp(np.array([3.0, -2.0, 5.0, 0.5, -1.0, 0.3]), "LPS", "camera")
    errors = rng.standard_normal((600, 6)) @ root.T
    found = [truth @ Pose.exp(error, "camera", "camera").inverse() for error in errors]
    squares = [normalised_square(one, truth, root @ root.T) for one in found]
    assert np.mean(squares) == pytest.approx(1.0, abs=0.08)
    assert np.mean([normalised_square(one, truth, 4 * root @ root.T) for one in found]) == pytest.approx(0.25, abs=0.02)
