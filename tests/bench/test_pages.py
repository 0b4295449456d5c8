"""Pages about benchmarks say what the committed results say."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

from naris.bench.result import BenchResult, Figure, Seconds

REPOSITORY = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def generator() -> ModuleType:
    path = REPOSITORY / "docs" / "make_benchmark_pages.py"
    if not path.is_file():
        pytest.skip("the generator of the pages is not part of a source distribution")
    spec = importlib.util.spec_from_file_location("make_benchmark_pages", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


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
    once = generator.filled(text, {SHARE.name: SHARE})
    assert "a <!-- figure demo.region_accuracy -->91.2 % (89.0 % … 93.0 %)<!-- end --> b" in once
    assert "<!-- figure other -->not measured yet<!-- end -->" in once
    assert generator.filled(once, {SHARE.name: SHARE}) == once
