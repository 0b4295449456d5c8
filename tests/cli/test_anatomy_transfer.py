"""`naris anatomy transfer`: regions of one anatomy on another, an honest no, and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from naris.anatomy.folder import load_anatomy, save_anatomy
from naris.cli import main
from naris.core.anatomy import SlabRegions
from tests.anatomy.test_correspondence import bent, marked_tube, moved
from tests.anatomy.test_transfer import OTHERS
from tests.winding_tube import SLABS


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """A tube with landmarks and one region only."""
    folder = tmp_path / "bare"
    save_anatomy(marked_tube().with_(regions={"all": SlabRegions("all", ("all",), "LPS", 1, ())}), folder)
    return folder


def reference(tmp_path: Path) -> Path:
    folder = tmp_path / "reference"
    save_anatomy(moved(marked_tube(), bent).with_(regions={"slabs": SLABS}), folder)
    return folder


def test_regions_are_carried_and_kept_first(bare: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    out = tmp_path / "with regions"
    words = ["anatomy", "transfer", str(bare), "-o", str(out), "--reference", str(reference(tmp_path))]
    assert main([*words, "--json", "--quiet"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["usable"]
    assert list(told["regions"]) == list(SLABS.names)
    assert "carried from another nose" in (out / "anatomy.html").read_text(encoding="utf-8")
    kept = load_anatomy(str(out))
    assert list(kept.regions) == ["slabs", "all"]
    line = marked_tube().passages[0].points_mm
    away = np.abs(line[:, 1:2] - np.array(SLABS.borders_mm)).min(axis=1) > 1.5
    assert (kept.region_set().label(line) == SLABS.label(line))[away].all()


def test_references_that_contradict_each_other_are_an_honest_no(
    bare: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "nothing"
    for name, slabs in (("one", SLABS), ("other", OTHERS)):
        save_anatomy(moved(marked_tube(), bent).with_(regions={"slabs": slabs}), tmp_path / name)
    references = ["--reference", str(tmp_path / "one"), str(tmp_path / "other")]
    assert main(["anatomy", "transfer", str(bare), "-o", str(out), *references, "--quiet"]) == 1
    assert "nothing was kept" in capfd.readouterr().out
    assert not out.exists()


def test_what_cannot_be_laid_is_refused_before_any_work(
    tube: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["anatomy", "transfer", str(tube), "-o", str(tmp_path / "out"), "--quiet"]) == 2
    assert "landmarks" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--reference", "REFERENCE", "--virtual", "3"], "--virtual without --reference, got 1 reference;"),
        (["--regions", "slabs"], "--regions only with --reference"),
        (["--virtual", "0"], "--virtual"),
        (["--reference", "nowhere"], "nowhere"),
        (["--reference", "REFERENCE", "--regions", "none"], "none"),
    ],
)
def test_what_cannot_be_is_refused_in_one_sentence(
    bare: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], options: list[str], says: str
) -> None:
    words = [str(reference(tmp_path)) if word == "REFERENCE" else word for word in options]
    assert main(["anatomy", "transfer", str(bare), "-o", str(tmp_path / "out"), *words, "--quiet"]) == 2
    said = capfd.readouterr()
    assert says in said.err
    assert said.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_regions_of_its_own_are_not_written_over_and_a_second_run_does_nothing(
    bare: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "own"
    save_anatomy(marked_tube().with_(regions={"slabs": OTHERS}), own)
    before = (own / "anatomy.json").read_bytes()
    given = ["--reference", str(reference(tmp_path)), "--quiet"]
    assert main(["anatomy", "transfer", str(own), "-o", str(own), *given]) == 2
    assert "which has its own" in capfd.readouterr().err
    assert (own / "anatomy.json").read_bytes() == before
    out = tmp_path / "copy"
    assert main(["anatomy", "transfer", str(own), "-o", str(out), *given]) == 0
    assert "instead of regions slabs that the anatomy had" in capfd.readouterr().out
    made = {path: path.stat().st_mtime_ns for path in out.iterdir()}
    assert main(["anatomy", "transfer", str(own), "-o", str(out), *given]) == 0
    assert "nothing was done" in capfd.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in out.iterdir()} == made
    (out / "anatomy.html").unlink()
    assert main(["anatomy", "transfer", str(out), "-o", str(out), *given]) == 0
    assert (out / "anatomy.html").is_file()


def test_after_an_interruption_the_same_command_goes_on(
    bare: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    words = ["anatomy", "transfer", str(bare), "-o", str(bare), "--reference", str(reference(tmp_path)), "--quiet"]
    with monkeypatch.context() as patched:

        def stopped(*_: object) -> None:
            raise KeyboardInterrupt

        patched.setattr("naris.cli.anatomy_transfer._write_picture", stopped)
        assert main(words) == 130
    assert "whole" in capfd.readouterr().err
    assert list(load_anatomy(bare).regions) == ["slabs", "all"]
    assert main(words) == 0
    assert (bare / "anatomy.html").is_file()


def test_a_reference_with_other_regions_is_another_one(
    bare: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    given, out = reference(tmp_path), tmp_path / "out"
    words = ["anatomy", "transfer", str(bare), "-o", str(out), "--reference", str(given), "--quiet"]
    assert main(words) == 0
    before = load_anatomy(out).region_set()
    save_anatomy(moved(marked_tube(), bent).with_(regions={"slabs": OTHERS}), given)
    capfd.readouterr()
    assert main(words) == 0
    assert "nothing was done" not in capfd.readouterr().out
    line = marked_tube().passages[0].points_mm
    assert (load_anatomy(out).region_set().label(line) != before.label(line)).mean() > 0.3
