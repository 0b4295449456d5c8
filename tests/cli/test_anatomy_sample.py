"""`naris anatomy sample`: a population that grows, and folders of others that are left alone."""

from __future__ import annotations

import contextlib
import itertools
import json
import re
from pathlib import Path

import numpy as np
import pytest

from naris.anatomy import gaussian_process, shape_model
from naris.anatomy.builtin import variation
from naris.anatomy.builtin.variants import VARIANTS
from naris.anatomy.folder import load_anatomy, save_anatomy
from naris.anatomy.shape_model import ShapeModel, save_shape_model
from naris.cli import main
from naris.core.anatomy import Anatomy
from naris.errors import PoseError
from tests.anatomy.test_correspondence import marked_tube


@pytest.mark.slow
def test_a_population_grows_and_is_the_same_again(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    words = ["anatomy", "sample", "-o", str(tmp_path / "a"), "--seed", "3", "--json", "--quiet", "--count"]
    assert main([*words, "1"]) == 0
    (first,) = json.loads(capfd.readouterr().out)["made"]
    assert main([*words, "2"]) == 0
    (second,) = json.loads(capfd.readouterr().out)["made"]
    assert first["digest"] != second["digest"]
    kept = load_anatomy(str(tmp_path / "a" / "0000"))
    assert kept.digest == first["digest"]
    assert {"paper", "anatomical"} <= set(kept.regions)
    assert len(kept.passages) == 8
    assert main([*words[:-2], "--quiet", "--seed", "4", "--count", "1"]) == 2
    assert "seed 3" in capfd.readouterr().err


def test_pictures_when_asked_of_those_that_are_there_too(
    tmp_path: Path, tube: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    words = ["anatomy", "sample", "-o", str(tmp_path / "a"), "--around", str(tube), "--quiet", "--count"]
    assert main([*words, "1"]) == 0
    assert not (tmp_path / "a" / "0000" / "anatomy.html").exists()
    assert main([*words, "2", "--pictures"]) == 0
    assert "1 was there already, each with a picture" in capfd.readouterr().out
    for number in range(2):
        page = (tmp_path / "a" / f"{number:04d}" / "anatomy.html").read_text()
        assert f"virtual patient {number} of seed 0" in page
        assert "no face crosses another" in page
    assert load_anatomy(str(tmp_path / "a" / "0001")).name == "virtual patient 1 of seed 0, like a winding tube"


def test_a_folder_with_something_else_is_left_alone(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    assert main(["anatomy", "sample", "-o", str(tmp_path), "--quiet"]) == 2
    assert "other files" in capfd.readouterr().err
    assert main(["anatomy", "sample", "-o", str(tmp_path / "notes.txt"), "--quiet"]) == 2
    assert main(["anatomy", "sample", "-o", str(tmp_path / "new"), "--count", "0", "--quiet"]) == 2
    assert not (tmp_path / "new").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]


@pytest.mark.long
def test_patients_around_an_anatomy_of_ones_own(
    tmp_path: Path, mean_nose_ply: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    """The mean nose, whose air lies between its walls, deformed; and nothing is drawn otherwise in that folder."""
    out = tmp_path / "a"
    words = ["anatomy", "sample", "-o", str(out), "--around", str(mean_nose_ply), "--count", "1", "--quiet"]
    assert main([*words, "--amplitude-mm", "1.2", "--json"]) == 0
    (made,) = json.loads(capfd.readouterr().out)["made"]
    assert "Gaussian process of 1.2 mm over 12 mm" in made["source"]
    kept, mean = load_anatomy(str(out / "0000")), load_anatomy(str(mean_nose_ply))
    assert kept.digest == made["digest"] != mean.digest
    assert kept.regions.keys() == mean.regions.keys()
    assert main([*words, "--amplitude-mm", "1.3"]) == 2
    assert "amplitude_mm 1.2" in capfd.readouterr().err
    assert main([*words[:-1], "--cycle-mm", "1", "--quiet"]) == 2
    assert "--cycle-mm only with landmarks of both sides" in capfd.readouterr().err


@pytest.mark.parametrize("population", ["ranges", "model"])
def test_how_many_draws_were_passed_over_is_told_with_the_reason(
    population: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """Every second nose has a passage that closes."""
    tries = itertools.count(1)

    def made(*given: object, **options: object) -> Anatomy:
        if next(tries) % 2:
            raise PoseError("passages in the lumen", "one outside it")
        return marked_tube()

    words = ["anatomy", "sample", "-o", str(tmp_path / "a"), "--count", "2", "--quiet"]
    if population == "model":
        monkeypatch.setattr(shape_model, "carried_along", made)
        mode = np.zeros((1, len(marked_tube().vertices_mm), 3), np.float32)
        save_shape_model(ShapeModel(marked_tube(), mode, np.ones(1), 3, 0.1), tmp_path / "model")
        words += ["--model", str(tmp_path / "model")]
    else:
        monkeypatch.setattr(variation, "built_in_nose", made)
    assert main([*words, "--json"]) == 0
    told = json.loads(capfd.readouterr().out)
    assert told["passed_over"]["a passage that closes"] == 2
    assert [one["passed_over"]["a passage that closes"] for one in told["made"]] == [1, 1]
    assert main([*words, "--count", "3"]) == 0
    said = capfd.readouterr().out
    assert "1 virtual patient made" in said and "2 were there already" in said
    assert "passed over: " in said and "1 with a passage that closes" in said


def test_draws_that_are_passed_over_are_told_and_come_to_an_end(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def closed(*given: object) -> Anatomy:
        raise PoseError("passages in the lumen", "one outside it")

    monkeypatch.setattr(gaussian_process, "carried_along", closed)
    save_anatomy(marked_tube(), tmp_path / "tube")
    words = ["anatomy", "sample", "-o", str(tmp_path / "a"), "--around", str(tmp_path / "tube"), "--count", "1"]
    assert main([*words, "--amplitude-mm", "0.1"]) == 1
    told = capfd.readouterr().err
    assert re.findall(r"patient 0: (\d+) of at most 20 draws", told) == ["5", "10", "15"]
    assert "no patient 0: " in told and "none in 20 draws (20 with a passage that closes); deform it less" in told


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--scale-mm", "5"], "--scale-mm only with --around"),
        (["--around", "builtin", "--model", "x"], "shape model"),
        (["--around", "builtin", "--variant", "polyps"], "--variant only with the built-in nose"),
        (["--around", "builtin", "--asymmetry", "2"], "an asymmetry of 0–1"),
    ],
)
def test_options_that_do_not_go_together(
    words: list[str], told: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["anatomy", "sample", "-o", str(tmp_path / "a"), *words, "--quiet"]) == 2
    assert told in capfd.readouterr().err
    assert not (tmp_path / "a").exists()


def _help(capfd: pytest.CaptureFixture[str]) -> str:
    with contextlib.suppress(SystemExit):
        main(["anatomy", "sample", "--help"])
    return re.sub(r"[\s│]+", " ", re.sub(r"\x1b\[[0-9;]*m", "", capfd.readouterr().out)).replace("- ", "-")


def test_every_variant_can_be_asked_for(capfd: pytest.CaptureFixture[str]) -> None:
    words = [name.replace(" ", "-") for name in VARIANTS]
    (choices,) = [re.findall(r"[a-z]+(?:-[a-z]+)*", one) for one in re.findall(r"--variant \{([^}]*)\}", _help(capfd))]
    assert choices == words
    assert main(["anatomy", "sample", "-o", "x", "--variant", "nonsense"]) == 2
