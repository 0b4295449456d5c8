"""`naris anatomy shape-model`, and `naris anatomy sample --model`: a population drawn from patients of one's own."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from naris.anatomy.folder import load_anatomy, save_anatomy
from naris.cli import main
from tests.anatomy.test_correspondence import marked_tube, moved


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """A reference, and tubes of three other widths."""
    root = tmp_path_factory.mktemp("patients")
    tubes = [marked_tube(), *(moved(marked_tube(), lambda p, s=s: p * [s, 1, 1]) for s in (0.8, 0.95, 1.2))]
    for number, tube in enumerate(tubes):
        save_anatomy(tube, root / str(number))
    return [str(root / str(number)) for number in range(len(tubes))]


@pytest.mark.long
def test_patients_are_drawn_from_a_model_of_patients(
    folders: list[str], tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    model, out = str(tmp_path / "model"), str(tmp_path / "drawn")
    words = ["anatomy", "shape-model", *folders[1:], "--reference", folders[0], "-o", model, "--json", "--quiet"]
    assert main(words) == 0
    told = json.loads(capfd.readouterr().out)
    assert (told["patients"], told["residual_mm"] < 0.5) == (3, True)
    assert told["share"] == sorted(told["share"], reverse=True)
    assert told["compactness"] == sorted(told["compactness"])
    assert told["generalisation_mm"][1] < 0.3 * told["generalisation_mm"][0]
    assert len(told["specificity_mm"]) == 3
    page = Path(told["page"]).read_text()
    assert page.count("against the number of modes") == 3
    assert "The mean" in page and "data:image/" in page
    assert main(["anatomy", "sample", "-o", out, "--model", model, "--count", "2", "--json", "--quiet"]) == 0
    first, second = json.loads(capfd.readouterr().out)["made"]
    assert first["digest"] != second["digest"]
    drawn = load_anatomy(first["folder"])
    assert "shape model of 3 patients" in drawn.source
    assert np.array_equal(drawn.faces, marked_tube().faces)
    assert drawn.passages[0].name == "main"
    assert main(["anatomy", "sample", "-o", out, "--count", "1", "--quiet"]) == 2
    assert "seed 0 from the shape model" in capfd.readouterr().err


def test_in_words(folders: list[str], tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    words = ["anatomy", "shape-model", *folders[1:], "--reference", folders[0], "-o", str(tmp_path / "model")]
    assert main([*words, "--quiet"]) == 0
    assert main([*words, "--quiet"]) == 0  # over its own
    told = capfd.readouterr().out
    for said in (
        "shape model of 3 noses",
        "generalisation",
        "by 1 mode of the others",
        "specificity",
        "shape_model.html",
    ):
        assert said in told


def test_what_cannot_be_is_refused(folders: list[str], tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "mine.txt").write_text("mine")
    out = ["-o", str(tmp_path / "model"), "--reference", folders[0], "--quiet"]
    for words, says in (
        (["anatomy", "shape-model", *folders[1:3], *out], "3 patients or more"),
        (["anatomy", "shape-model", *folders[1:], f"{folders[2]}/anatomy.json", *out], "every patient once"),
        (["anatomy", "shape-model", *folders[1:], folders[1], *out], "every patient once"),
        (["anatomy", "shape-model", "--virtual", "2", *out], "--virtual 3 or more"),
        (["anatomy", "shape-model", *folders[1:], *out, "--virtual", "3"], "--virtual without patients"),
        (["anatomy", "shape-model", *folders[1:], "-o", str(tmp_path / "notes")], "other files"),
        (["anatomy", "sample", "-o", str(tmp_path / "new"), "--model", str(tmp_path / "notes")], "a shape model"),
    ):
        assert main(words) == 2
        said = capfd.readouterr().err
        assert says in said
        assert said.count("\n") == 1
    assert sorted(path.name for path in tmp_path.iterdir()) == ["notes"]
