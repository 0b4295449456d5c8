"""Pages about benchmarks say what the committed results say."""

from __future__ import annotations

import importlib.util
import sys
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest

from naris.bench.chain_patient import BELIEFS, PREDICTION
from naris.bench.result import BenchResult, Figure, Seconds

REPOSITORY = Path(__file__).resolve().parents[2]


def script(name: str) -> ModuleType:
    path = REPOSITORY / "docs" / f"{name}.py"
    if not path.is_file():
        pytest.skip("the generators of the pages are not part of a source distribution")
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def generator() -> ModuleType:
    return script("make_benchmark_pages")


SPEED = Figure(
    "render.plain.300.cpu_ms", 8.25, "ms", 200, "lower", 9.0, (8.0, 8.5), {"PyVista": 52.0, "GL": "no screen"}
)
SHARE = Figure("demo.region_accuracy", 0.912, "1", 600, "higher", 0.95, (0.89, 0.93))
RESULT = BenchResult(
    "naris bench render", "abc", {"processor": "p", "cores": 2}, {"naris": "1"}, 4, Seconds(10, 19), (SPEED, SHARE)
)


def test_the_committed_pages_are_those_of_the_results(generator: ModuleType) -> None:
    for path, text in generator.pages(REPOSITORY / "benchmarks" / "results", REPOSITORY / "docs").items():
        assert path.read_text(encoding="utf-8") == text, f"run python docs/make_benchmark_pages.py ({path.name})"


def test_every_figure_of_a_result_stands_in_the_page(generator: ModuleType) -> None:
    page = generator.benchmarks({"render": RESULT})
    assert "| `render.plain.300.cpu_ms` | **8.25 ms** | 8 ms … 8.5 ms | ≤ 9 ms: reached | 200 |" in page
    assert "| `demo.region_accuracy` | **91.2 %** | 89.0 % … 93.0 % | ≥ 95.0 %: missed | 600 |" in page
    assert "`render.plain.300.cpu_ms` by PyVista: 52 ms" in page
    assert "`render.plain.300.cpu_ms` by GL: no screen" in page
    assert "commit abc" in page
    assert "10 s wall, 19 s CPU" in page


def test_marks_are_filled_again_and_again(generator: ModuleType) -> None:
    text = "a <!-- figure demo.region_accuracy -->old\nwords<!-- end --> b <!-- figure other --><!-- end -->"
    text += " c <!-- value demo.region_accuracy -->0<!-- end -->"
    once = generator.filled(text, {SHARE.name: SHARE})
    assert "a <!-- figure demo.region_accuracy -->91.2 % (89.0 % … 93.0 %)<!-- end --> b" in once
    assert "<!-- figure other -->not measured yet<!-- end -->" in once
    assert once.endswith("c <!-- value demo.region_accuracy -->91.2 %<!-- end -->")
    assert generator.filled(once, {SHARE.name: SHARE}) == once


def test_the_figure_of_the_chain_parts_all_frames(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    drawer = script("make_chain_figure")
    parts = {"tre_lt2": 0.5, "refused": 0.375, "accepted_wrong": 0.125, "likeliest_lt2": 0.75}
    names = [f"register.chain.{noise}{belief}" for noise in drawer.NOISES for belief in drawer.TOLD]
    made = [Figure(f"{name}.{part}", value, "1", 8, "higher", 0.7) for name in names for part, value in parts.items()]
    result = replace(RESULT, figures=tuple(made), inputs={"patients": "one"})
    assert drawer.shares(result, names[0]).each == (0.5, 0.25, 0.125, 0.125)
    drawer.draw(result, tmp_path / "chain.png")
    assert (tmp_path / "chain.png").stat().st_size > 1000


def test_the_figure_of_the_chain_shows_every_belief() -> None:
    pytest.importorskip("matplotlib")
    told = {belief.removeprefix(".") for belief in script("make_chain_figure").TOLD}
    assert told == {"" if belief == PREDICTION else belief for belief in BELIEFS}
