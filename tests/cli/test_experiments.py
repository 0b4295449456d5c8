"""`naris demo`, `naris reproduce` and `naris bench demo`, whole and in small."""

from __future__ import annotations

import json
from dataclasses import asdict, fields, replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest

import naris.bench.demo
import naris.demo
import naris.reproduce
from naris.anatomy.builtin import built_in_nose
from naris.cli import bench, main
from naris.core.provenance import plain
from naris.dataset.splits import SplitSizes
from naris.demo import DemoConfig
from naris.experiment.claim import claim
from tests.winding_tube import SLABS

NOSE = cache(built_in_nose)
TINY = DemoConfig(train_positions=12, test_positions=4, per_position=2, epochs=1, budget_s=1.0, located=2)


@pytest.fixture
def few_to_calibrate_with(monkeypatch: pytest.MonkeyPatch) -> None:
    """As few pictures as may be: a network that learned for a second says nothing that is worth more."""
    monkeypatch.setattr("naris.train.fit._KEPT_PICTURES", 64)


def test_a_folder_of_somebody_else_is_refused(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "report.html").write_text("mine")
    assert main(["demo", "-o", str(tmp_path)]) == 2
    assert capfd.readouterr().err.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["report.html"]
    assert (tmp_path / "report.html").read_text() == "mine"


def test_a_demo_with_other_settings_is_refused_by_their_names(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    claim(tmp_path, {"experiment": "demo", "config": plain(DemoConfig())})
    assert main(["demo", "-o", str(tmp_path), "--seed", "3", "--budget-s", "90"]) == 2
    assert "got other settings: --budget-s (none → 90), --seed (0 → 3); give another" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("name", "work", "told"),
    [
        ("demo", None, "begins anew"),
        ("simulate", Path("w"), "begins anew"),
        ("reproduce", None, "--work"),
        ("reproduce", Path("w"), "goes on"),
        ("chain", None, "--work"),
        ("chain", Path("w"), "goes on"),
    ],
)
def test_an_interrupted_benchmark_promises_what_it_keeps(name: str, work: Path | None, told: str) -> None:
    assert told in bench.interrupted(bench.Options(name, work=work))


@pytest.mark.slow
@pytest.mark.usefixtures("few_to_calibrate_with")
def test_a_demo_ends_with_its_files_and_a_second_tells_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(naris.demo, "built_in_nose", NOSE)
    whole = naris.demo.demo
    small = {
        name: getattr(TINY, name) for name in ("train_positions", "test_positions", "per_position", "epochs", "located")
    }
    monkeypatch.setattr(naris.demo, "demo", lambda out, config, **named: whole(out, replace(config, **small), **named))
    words = ["demo", "-o", str(tmp_path / "out"), "--budget-s", "1", "--json", "--quiet"]
    told = []
    for _ in range(2):
        assert main(words) == 0
        told.append(json.loads(capfd.readouterr().out))
        assert json.loads((tmp_path / "out" / "figures.json").read_text())["figures"] == told[-1]["figures"]
    first, second = ({figure["name"]: figure["value"] for figure in one["figures"]} for one in told)
    assert first == second
    assert first.keys() == {
        "demo.region_accuracy",
        "demo.training_pictures",
        "demo.seconds",
        "demo.position_median_mm",
    }
    assert told[0]["seconds"] == told[1]["seconds"]
    assert told[0]["seconds"]["wall"] == first["demo.seconds"] > 1.0
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "built-in nose" in page
    assert "two-layer, as published" not in page


@pytest.mark.long
def test_reproduce_ends_with_its_files(
    tmp_path: Path, tube: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    whole = naris.reproduce.reproduce
    sizes = SplitSizes(train_positions=12, test_positions=4, per_position=2)
    monkeypatch.setattr(
        naris.reproduce,
        "reproduce",
        lambda anatomy, texture, out, config, **named: whole(
            anatomy, texture, out, replace(config, sizes=sizes), **named
        ),
    )
    texture = tmp_path / "texture.png"
    cv2.imwrite(str(texture), np.random.default_rng(0).integers(60, 200, (40, 50, 3), dtype=np.uint8))
    words = ["reproduce", "--anatomy", str(tube), "--texture", str(texture), "--regions", SLABS.name]
    words += ["-o", str(tmp_path / "out"), "--epochs", "1", "--compact-epochs", "1", "--runs", "1"]
    words += ["--at-will-steps", "2", "--workers", "1", "--json", "--quiet"]
    told = []
    for _ in range(2):
        assert main(words) == 0
        told.append(json.loads(capfd.readouterr().out))
    assert told[0]["figures"] == told[1]["figures"]
    assert told[0]["seconds"] == told[1]["seconds"]
    names = {figure["name"] for figure in told[0]["figures"]}
    assert {"reproduce.two_layer.training_seconds", "reproduce.compact.at_will.accuracy"} <= names
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        *("settings.json", "stages.json", "figures.json", "report.html"),
        *("pictures", "two_layer", "compact", "compact_at_will"),
    }


@pytest.mark.long
@pytest.mark.usefixtures("few_to_calibrate_with")
def test_the_demo_benchmark_measures_its_figures(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(naris.demo, "built_in_nose", NOSE)
    monkeypatch.setattr(naris.bench.demo, "QUICK", TINY)
    words = ["bench", "demo", "--quick", "--work", str(tmp_path), "-o", str(tmp_path / "demo.json"), "--json"]
    assert main([*words, "--quiet"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told == json.loads((tmp_path / "demo.json").read_text())
    assert {figure["name"] for figure in told["figures"]} >= {"demo.region_accuracy", "demo.seconds"}
    assert [path.name for path in tmp_path.iterdir()] == ["demo.json"]


def test_the_command_line_asks_for_what_the_experiment_is() -> None:
    """`naris bench reproduce` runs the one, `naris reproduce` the other, and they share a folder."""
    from naris.cli.reproduce import Options

    asked = {field.name: field.default for field in fields(Options)}
    for name, value in asdict(naris.reproduce.ReproduceConfig()).items():
        if name in asked:
            assert asked[name] == value, name
