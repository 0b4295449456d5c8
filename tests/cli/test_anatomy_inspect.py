"""`naris anatomy inspect`: whether a scan will do, in words, JSON and exit status."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from naris.cli import main
from naris.ct.write import write_dicom, write_nrrd
from tests import simulated_head
from tests.cli.test_anatomy_from_ct import head_without_nostrils


@pytest.mark.slow
def test_a_scan_that_will_do(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    series = tmp_path / "JOHN_DOE"
    write_dicom(simulated_head.scan(), series, "a nose")
    assert main(["anatomy", "inspect", str(series), "--json", "--quiet"]) == 0
    said = capfd.readouterr().out
    told = json.loads(said)
    assert told["usable"] is True
    assert told["format"] == "DICOM"
    assert told["reach_mm"]["behind"] > 85
    assert told["volume_ml"]["left nasal cavity"] > 5
    assert told["step_mm"] == 0.8
    assert "JOHN" not in said
    assert main(["anatomy", "inspect", str(series), "--quiet"]) == 0
    assert "at a glance, on a lattice of 0.8 mm; naris anatomy from-ct measures them" in capfd.readouterr().out


def test_a_scan_that_will_not(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    scan = tmp_path / "scan.nrrd"
    write_nrrd(head_without_nostrils(), scan)
    assert main(["anatomy", "inspect", str(scan), "--quiet"]) == 1
    said = capfd.readouterr().out
    assert said.startswith("no usable airway: expected ")
    assert "beyond the tip of the nose" in said
    assert list(tmp_path.iterdir()) == [scan]


def test_a_file_that_is_no_scan_is_bad_input(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    scan = tmp_path / "scan.nrrd"
    scan.write_text("not a scan")
    assert main(["anatomy", "inspect", str(scan)]) == 2
    assert capfd.readouterr().err.startswith("naris: expected ")
