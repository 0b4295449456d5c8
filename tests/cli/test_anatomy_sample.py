"""`naris anatomy sample`: a population that grows, and folders of others that are left alone."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from naris.anatomy.folder import load_anatomy
from naris.cli import main


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


def test_a_folder_with_something_else_is_left_alone(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    assert main(["anatomy", "sample", "-o", str(tmp_path), "--quiet"]) == 2
    assert "other files" in capfd.readouterr().err
    assert main(["anatomy", "sample", "-o", str(tmp_path / "notes.txt"), "--quiet"]) == 2
    assert main(["anatomy", "sample", "-o", str(tmp_path / "new"), "--count", "0", "--quiet"]) == 2
    assert not (tmp_path / "new").exists()
    assert [path.name for path in tmp_path.iterdir()] == ["notes.txt"]
