"""Numbers that no verb can use, options without effect: one sentence and status 2, before anything is touched."""

from __future__ import annotations

import contextlib
import dataclasses
import importlib
import math
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from naris.cli import VERBS, main
from naris.cli.options import ALLOWED, Range, check_name, flag
from naris.errors import InputError


@pytest.mark.parametrize(
    "words",
    [
        "simulate builtin -o out --seed -1",
        "simulate builtin -o out --seed 9223372036854775808",
        "simulate builtin -o out --workers -1",
        "simulate builtin -o out --per-position 0",
        "simulate builtin -o out --step-mm inf",
        "demo -o out --seed -1",
        "demo -o out --budget-s nan",
        "reproduce --anatomy builtin --texture x.png -o out --seed -1",
        "reproduce --anatomy builtin --texture x.png -o out --workers 0",
        "bench render --work out --seed -1",
        "bench chain --work out --patients 0",
        "train builtin -o out --seeds 0 -1",
        "train builtin -o out --budget-s nan",
        "train builtin -o out --budget-s 0",
        "train builtin -o out --workers 0",
        "evaluate x -d y -o out --threads -1",
        "locate x.png -m y --threads -1",
        "locate x.png -m y --probability nan",
        "locate x.png -m y --probability 7",
        "locate x.png -m y --out-of-domain -1",
        "register builtin --cloud x.txt --method imlop --normals-deg 0",
        "fetch mean-nose -o out --timeout-s -1",
        "fetch mean-nose -o out --timeout-s 1e300",
        "fetch mean-nose -o out --attempts 0",
        "anatomy sample -o out --around builtin --amplitude-mm 20",
        "anatomy sample -o out --around builtin --amplitude-mm -1",
    ],
)
def test_a_number_out_of_range_gets_one_sentence_that_names_it(words: str, tmp_path: Path, monkeypatch, capfd) -> None:
    monkeypatch.chdir(tmp_path)
    option = re.findall(r"--[a-z-]+", words)[-1]
    assert main(words.split()) == 2
    told = capfd.readouterr()
    assert re.fullmatch(rf"naris: expected {option} a [^\n]+, got [^\n]+; [^\n]+\n", told.err), told.err
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("anatomy builtin --unit mm", "--unit"),
        ("anatomy builtin --unit cm --frame LPS", "--unit, --frame"),
        ("anatomy nose.ply --set cavity_length_mm=70", "--set"),
        ("simulate builtin -o out --keyframes keys.json --count 5", "--count"),
        ("simulate builtin -o out --keyframes keys.json --views trajectories --count 5", "--count, --views"),
        ("simulate builtin -o out --step-mm 1", "--step-mm"),
        ("simulate builtin -o out --views travel --per-position 10", "--per-position"),
        ("train builtin -o out --workers 1", "--workers"),
        ("train builtin -o out --scopes many --fov-deg 45", "--fov-deg"),
        ("bench demo --work out --anatomy builtin", "--anatomy"),
        ("bench chain --work out --anatomy builtin", "--anatomy"),
        ("bench demo --work out --patients 3 --fit-steps 9", "--patients, --fit-steps"),
    ],
)
def test_an_option_without_effect_gets_one_sentence_that_names_it(
    words: str, named: str, tmp_path: Path, monkeypatch, capfd
) -> None:
    """Also where what is given is what holds without it."""
    monkeypatch.chdir(tmp_path)
    assert main(words.split()) == 2
    told = capfd.readouterr()
    assert told.out == ""
    assert re.fullmatch(rf"naris: expected {named} (only )?with[^\n]+, got [^\n]+; leave [^\n]+ out\n", told.err), (
        told.err
    )
    assert not list(tmp_path.iterdir())


def test_the_ranges_are_of_options_that_there_are_and_allow_their_defaults() -> None:
    known = set()
    for verb in VERBS.values():
        options = importlib.import_module(verb.module).Options
        for field in dataclasses.fields(options):
            known.add(field.name)
            if isinstance(field.default, (int, float)):
                assert field.default in ALLOWED.get(field.name, Range())
    assert set(ALLOWED) <= known


def test_locating_doubts_as_the_library_does() -> None:
    from naris.cli.locate import Options
    from naris.locate import Doubt

    options = Options(pictures=(), model=Path("x"))
    assert Doubt(options.out_of_domain, options.probability) == Doubt()


def limits() -> Iterator[tuple[str, str, float]]:
    """The verb, the option and the end of every range with two ends among the verbs of anatomies, but for the seed."""
    yield "anatomy from-ct", "step_mm", 0.2
    yield "anatomy from-ct", "step_mm", 1.0
    for name, verb in VERBS.items():
        for field in dataclasses.fields(importlib.import_module(verb.module).Options):
            allowed = ALLOWED.get(field.name, Range())
            if name.startswith("anatomy") and field.name != "seed" and math.isfinite(allowed.most):
                yield name, field.name, allowed.most


@pytest.mark.parametrize(("verb", "option", "limit"), list(limits()))
def test_help_tells_between_which_numbers_an_option_must_lie(verb: str, option: str, limit: float, capfd) -> None:
    with contextlib.suppress(SystemExit):
        main([*verb.split(), "--help"])
    told = re.sub(r"[\s│]+", " ", re.sub(r"\x1b\[[0-9;]*m", "", capfd.readouterr().out))
    (said,) = re.findall(rf" {flag(option)} [A-Z]+ (.*?) \((?:default|optional)", told)
    assert re.search(rf"\b{re.escape(str(limit))}\b", said), said


@pytest.mark.parametrize("name", ["", "  ", "two\nlines", "x" * 81])
def test_a_name_that_cannot_stand_in_a_line_is_refused(name: str) -> None:
    check_name("nose 12, after surgery")
    with pytest.raises(InputError, match="--name of 1 to 80 printed letters"):
        check_name(name)
