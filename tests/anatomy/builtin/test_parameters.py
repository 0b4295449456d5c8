"""Parameters refuse nonsense, and tell where their ranges come from."""

from __future__ import annotations

import re
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from naris.anatomy.builtin import NORMAL_RANGES, NoseParameters
from naris.core.anatomy import Anatomy
from naris.errors import InputError

NAMES = sorted(NORMAL_RANGES)
DOCS = Path(__file__).resolve().parents[3] / "docs"


def test_every_length_has_a_range_a_unit_and_a_source() -> None:
    assert {f.name for f in fields(NoseParameters)} - set(NORMAL_RANGES) == {"irregularity_seed"}
    for name, normal in NORMAL_RANGES.items():
        assert normal.minimum <= normal.low < normal.high <= normal.maximum, name
        assert normal.unit == ("°" if name.endswith("_deg") else "mm"), name
        assert normal.meaning and len(normal.source) > 8, name


def test_defaults_are_normal() -> None:
    default = NoseParameters()
    for name, normal in NORMAL_RANGES.items():
        assert normal.low <= getattr(default, name) <= normal.high, name


@given(name=st.sampled_from(NAMES), share=st.floats(0, 1))
def test_whatever_is_accepted_is_kept(name: str, share: float) -> None:
    normal = NORMAL_RANGES[name]
    value = min(max(normal.minimum + share * (normal.maximum - normal.minimum), normal.minimum), normal.maximum)
    assert getattr(NoseParameters(**{name: value}), name) == value


@given(name=st.sampled_from(NAMES), value=st.floats(allow_nan=True, allow_infinity=True))
def test_whatever_lies_outside_is_refused_by_name(name: str, value: float) -> None:
    normal = NORMAL_RANGES[name]
    if not normal.minimum <= value <= normal.maximum:
        with pytest.raises(InputError, match=name):
            NoseParameters(**{name: value})


@pytest.mark.parametrize("seed", [-1, -100])
def test_a_negative_seed_is_refused(seed: int) -> None:
    with pytest.raises(InputError, match="irregularity_seed"):
        NoseParameters(irregularity_seed=seed)


def test_the_page_tells_the_parameters_as_they_are() -> None:
    page = (DOCS / "builtin_nose.md").read_text()
    default = NoseParameters()
    for name, normal in NORMAL_RANGES.items():
        row = f"| `{name}` | {getattr(default, name):g} {normal.unit} | {normal.low:g} to {normal.high:g} |"
        assert row in page, "run docs/make_builtin_nose_figures.py"


def test_the_page_tells_the_passages_as_they_are(nose: Anatomy) -> None:
    page = (DOCS / "builtin_nose.md").read_text()
    told = re.findall(r"\| passage `(.*)` \| (\d+) mm, from its middle to the wall ([\d.]+)–([\d.]+) mm \|", page)
    assert [name for name, *_ in told] == [one.name for one in nose.passages], "run docs/make_builtin_nose_figures.py"
    for (_, *numbers), one in zip(told, nose.passages, strict=True):
        measured = [one.length_mm, one.clearance_mm.min(), one.clearance_mm.max()]
        # The last digits of a mesh differ between machines.
        assert np.all(np.abs(np.array(numbers, dtype=float) - measured) < [0.6, 0.02, 0.02]), one.name


def test_the_figures_of_the_page_exist_and_are_light() -> None:
    page = (DOCS / "builtin_nose.md").read_text()
    named = [part.split(")")[0] for part in page.split("](")[1:] if part.startswith("figures/")]
    assert named
    for name in named:
        assert (DOCS / name).stat().st_size <= 300 * 1024, name
