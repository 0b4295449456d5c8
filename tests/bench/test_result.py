"""Benchmark results: what is written is what was measured."""

from __future__ import annotations

import json
import math
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from naris.bench.result import SCHEMA, BenchResult, Figure, Seconds, read_result, wilson
from naris.errors import InputError

names = st.text(min_size=1, max_size=20)
numbers = st.floats(-1e6, 1e6)
figures = st.builds(
    Figure,
    name=names,
    value=st.none() | numbers,
    unit=names,
    n=st.integers(0, 10**6),
    better=st.sampled_from(["higher", "lower"]),
    goal=st.none() | numbers,
    interval=st.none() | st.tuples(numbers, numbers),
    peers=st.dictionaries(names, numbers | names, max_size=3),
)
results = st.builds(
    BenchResult,
    command=names,
    commit=st.none() | names,
    machine=st.dictionaries(names, names | st.integers(0, 100), max_size=3),
    versions=st.dictionaries(names, names, max_size=3),
    seed=st.integers(0, 2**31),
    seconds=st.builds(Seconds, numbers, numbers),
    figures=st.lists(figures, max_size=4).map(tuple),
    inputs=st.dictionaries(names, names, max_size=2),
)


@given(results)
def test_json_and_back(result: BenchResult) -> None:
    assert BenchResult.from_json(result.to_json()) == result


@given(results)
def test_schema_of_the_house(result: BenchResult) -> None:
    raw = json.loads(result.to_json())
    assert next(iter(raw)) == "schema"
    assert raw["schema"] == SCHEMA
    assert {"command", "commit", "machine", "versions", "seed", "seconds", "figures"} <= raw.keys()
    keys = {"name", "value", "unit", "n", "better", "goal", "interval", "peers"}
    assert all(set(figure) == keys for figure in raw["figures"])


@pytest.mark.parametrize(
    ("value", "better", "goal", "expected"),
    [
        (5.0, "lower", 9.0, True),
        (9.0, "lower", 9.0, True),
        (9.1, "lower", 9.0, False),
        (0.9, "higher", 0.85, True),
        (0.8, "higher", 0.85, False),
        (0.8, "higher", None, None),
        (None, "higher", 0.85, None),
    ],
)
def test_goals(value: float | None, better: str, goal: float | None, expected: bool | None) -> None:
    assert Figure("f", value, "1", 1, better, goal).reached is expected  # type: ignore[arg-type]


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_numbers_are_finite(bad: float) -> None:
    with pytest.raises(InputError, match="finite"):
        Figure("f", bad, "ms", 1, "lower")
    with pytest.raises(InputError, match="finite"):
        Figure("f", 1.0, "ms", 1, "lower", peers={"other": bad})


def test_figures_by_name() -> None:
    figure = Figure("render.plain.300.cpu_ms", 8.0, "ms", 100, "lower", 9.0)
    result = BenchResult("naris bench render", None, {}, {}, 0, Seconds(1, 2), (figure,))
    assert result.figure("render.plain.300.cpu_ms") is figure
    with pytest.raises(InputError, match=r"render\.plain\.300\.cpu_ms"):
        result.figure("render.plain")


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"schema": "other/1"}', f'{{"schema": "{SCHEMA}"}}', "null"])
def test_other_files_are_refused(text: str, tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.write_text(text)
    with pytest.raises(InputError, match="benchmark result"):
        read_result(path)


def test_a_missing_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.json"):
        read_result(tmp_path / "none.json")


@pytest.mark.parametrize(
    ("right", "n", "low", "high"), [(60, 60, 0.940, 1.0), (0, 10, 0.0, 0.278), (50, 100, 0.404, 0.596)]
)
def test_the_interval_of_a_share_is_wilsons(right: int, n: int, low: float, high: float) -> None:
    assert wilson(right, n) == pytest.approx((low, high), abs=1e-3)
