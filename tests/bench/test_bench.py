"""`naris bench`: what it tells, writes and refuses."""

from __future__ import annotations

import importlib
import json
import sys
import types
from pathlib import Path

import pytest

from naris import bench
from naris.anatomy.folder import save_anatomy
from naris.bench import BENCHMARKS, Benchmark, BenchRequest, Measurement
from naris.bench.result import Figure, read_result
from naris.cli import main
from naris.dataset.splits import SplitSizes
from tests.winding_tube import winding_tube


@pytest.fixture
def probe(monkeypatch: pytest.MonkeyPatch) -> list[BenchRequest]:
    """A benchmark that measures nothing; gives what it was asked."""
    asked: list[BenchRequest] = []

    def measure(request: BenchRequest) -> Measurement:
        asked.append(request)
        peers = {"peer": 30.0, "other": "needs a screen"}
        figures = (
            Figure("probe.speed", 8.0, "ms", 5 if request.quick else 100, "lower", 9.0, (7.5, 8.5), peers),
            Figure("probe.share", 0.5, "1", 10, "higher", 0.9),
        )
        return Measurement(figures, {"anatomy": "none"})

    module = types.ModuleType("naris_probe_benchmark")
    module.measure = measure  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "naris_probe_benchmark", module)
    monkeypatch.setattr(bench, "BENCHMARKS", {"probe": Benchmark("naris_probe_benchmark", "nothing")})
    return asked


def test_what_was_measured_is_told_and_written(probe: list[BenchRequest], tmp_path: Path, capfd) -> None:
    out = tmp_path / "new" / "probe.json"
    assert main(["bench", "probe", "--quick", "--seed", "3", "--json", "-o", str(out)]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told == json.loads(out.read_text())
    result = read_result(out)
    assert result.seed == 3
    assert result.inputs == {"anatomy": "none"}
    assert result.figure("probe.speed").n == 5
    assert result.seconds.wall >= 0
    assert {"naris", "python"} <= result.versions.keys()
    assert {"processor", "cores"} <= result.machine.keys()
    assert probe[0].quick
    assert probe[0].seed == 3


def test_goals_and_peers_stand_in_the_text(probe: list[BenchRequest], capfd) -> None:
    assert main(["bench", "probe"]) == 0
    text = capfd.readouterr().out
    text = " ".join(text.split())
    assert "goal ≤ 9 reached" in text
    assert "goal ≥ 0.9 missed" in text
    assert "probe.speed by peer: 30 ms" in text
    assert "probe.speed by other: needs a screen" in text
    assert not probe[0].quick


def test_unknown_benchmarks_are_refused(capfd) -> None:
    assert main(["bench", "nothing-such"]) == 2
    said = capfd.readouterr().err
    assert said.count("\n") == 1
    assert all(name in said for name in BENCHMARKS)


def test_one_part_can_be_measured_alone(probe: list[BenchRequest], monkeypatch: pytest.MonkeyPatch, capfd) -> None:
    assert main(["bench", "probe", "--only", "speed"]) == 2
    assert "it has no parts" in capfd.readouterr().err
    monkeypatch.setattr(
        bench, "BENCHMARKS", {"probe": Benchmark("naris_probe_benchmark", "nothing", ("speed", "share"))}
    )
    assert main(["bench", "probe", "--only", "size"]) == 2
    assert "one of the parts speed, share of probe" in capfd.readouterr().err
    assert main(["bench", "probe", "--only", "speed"]) == 0
    assert probe[0].wants("speed")
    assert not probe[0].wants("share")
    assert BenchRequest().wants("share")


@pytest.mark.parametrize("name", list(BENCHMARKS))
def test_every_benchmark_that_is_listed_is_there(name: str) -> None:
    assert callable(importlib.import_module(BENCHMARKS[name].module).measure)


def test_simulate_counts_the_published_pictures(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from naris.bench import simulate

    published = simulate.SIZES
    assert (published.train_positions + published.test_positions) * published.per_position == 1420
    monkeypatch.setattr(simulate, "SIZES", SplitSizes(train_positions=16, test_positions=4, per_position=2))
    save_anatomy(winding_tube(), tmp_path / "tube")
    out = tmp_path / "simulate.json"
    assert main(["bench", "simulate", "--anatomy", str(tmp_path / "tube"), "-o", str(out), "--quiet"]) == 0
    result = read_result(out)
    figure = result.figure("simulate.40.seconds")
    assert figure.n == 40
    assert figure.goal == 60
    assert 0 < (figure.value or 0) < result.seconds.wall
    assert (result.figure("simulate.40.cpu_seconds").value or 0) < result.seconds.cpu
    assert "winding tube" in result.inputs["anatomy"]
