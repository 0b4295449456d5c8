"""`naris anatomy from-ct`: a whole anatomy from a scan, and no anatomy from what holds none."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path

import nrrd
import numpy as np
import pytest

from naris.anatomy.folder import load_anatomy, save_anatomy
from naris.anatomy.virtual_ct import Scanner, virtual_ct
from naris.cli import main
from naris.core.volume import Volume
from naris.ct.write import write_dicom, write_nrrd
from tests import simulated_head
from tests.anatomy.shapes import sphere


@pytest.mark.slow
def test_a_series_becomes_an_anatomy_that_other_verbs_open(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    series, out = tmp_path / "JOHN_DOE", tmp_path / "nose"
    write_dicom(virtual_ct(simulated_head.nose(), Scanner(spacing_mm=(0.6, 0.6, 1.0), tilt_deg=9)), series, "a nose")
    assert main(["anatomy", "from-ct", str(series), "-o", str(out), "--step-mm", "1", "--json", "--quiet"]) == 0
    told = json.loads(capfd.readouterr().out)
    anatomy = load_anatomy(out)
    assert told["digest"] == anatomy.digest
    assert told["step_mm"] == 1.0
    assert {"left.main", "right.main"} <= {one.name for one in anatomy.passages}
    labels, _ = nrrd.read(told["segmentation"])
    assert set(np.unique(labels)) >= {0, 1, 2, 3}
    assert "patient" in Path(told["picture"]).read_text(encoding="utf-8")
    for path in out.iterdir():
        assert b"JOHN" not in path.read_bytes(), path.name
    assert main(["anatomy", str(out), "--json", "--quiet"]) == 0
    assert json.loads(capfd.readouterr().out)["closed"]
    words = ["anatomy", "from-ct", str(series), "-o", str(out), "--quiet", "--step-mm"]
    before = {path: path.stat().st_mtime_ns for path in out.iterdir()}
    assert main([*words, "1", "--json"]) == 0
    assert json.loads(capfd.readouterr().out) == told | {"already": True}
    assert main([*words, "1"]) == 0
    assert "it was there already, of these settings; nothing was done" in capfd.readouterr().out
    assert {path: path.stat().st_mtime_ns for path in out.iterdir()} == before
    _regions_are_added_on_the_scan(out, tmp_path / "regions")


@pytest.mark.long
def test_with_other_settings_the_anatomy_of_the_same_scan_is_made_anew_and_what_is_missing_as_well(
    tmp_path: Path,
) -> None:
    scan, out = tmp_path / "scan.nrrd", tmp_path / "nose"
    write_nrrd(virtual_ct(simulated_head.nose(), Scanner(spacing_mm=(0.8, 0.8, 1.0))), scan)
    words = ["anatomy", "from-ct", str(scan), "-o", str(out), "--quiet", "--step-mm"]
    for step in ("0.8", "0.9"):
        assert main([*words, step]) == 0
        assert f"{step} mm" in load_anatomy(out).source
    picture = out / "anatomy.html"
    picture.unlink()
    assert main([*words, "0.9"]) == 0
    assert picture.is_file()


def _regions_are_added_on_the_scan(nose: Path, out: Path) -> None:
    """The picture with the regions of another nose shows the scan as well, here and in what is made of that."""
    save_anatomy(simulated_head.nose(), out.with_name("reference"))
    reference = ["--reference", str(out.with_name("reference"))]
    assert main(["anatomy", "transfer", str(nose), "-o", str(out), *reference, "--quiet"]) == 0
    assert "on the scan" in (out / "anatomy.html").read_text(encoding="utf-8")
    assert main(["anatomy", str(out), "-o", str(out.with_name("again")), "--quiet"]) == 0
    assert "on the scan" in (out.with_name("again") / "anatomy.html").read_text(encoding="utf-8")


def head_without_nostrils() -> Volume:
    """A ball of tissue with a bump for a nose, and air in front of it, nowhere inside."""
    x, y, z = np.meshgrid(*[np.linspace(-70, 70, 71)] * 3, indexing="ij")
    tissue = (x**2 + y**2 + z**2 < 55**2) | (x**2 + (y + 55) ** 2 + z**2 < 12**2)
    noise = np.random.default_rng(0).normal(0, 20, x.shape)
    matrix = np.diag([2.0, 2.0, 2.0, 1.0])
    matrix[:3, 3] = -70
    return Volume((np.where(tissue, 40, -1000) + noise).astype(np.int16), matrix)


def test_a_head_without_an_airway_is_an_honest_no(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    scan, out = tmp_path / "scan.nrrd", tmp_path / "nose"
    write_nrrd(head_without_nostrils(), scan)
    assert main(["anatomy", "from-ct", str(scan), "-o", str(out), "--step-mm", "1", "--json", "--quiet"]) == 1
    told = json.loads(capfd.readouterr().out)
    assert told["usable"] is False
    assert told["reason"]
    assert not out.exists()


def test_a_refusal_says_that_an_earlier_anatomy_is_still_there(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    scan, out = tmp_path / "scan.nrrd", tmp_path / "nose"
    head = head_without_nostrils()
    write_nrrd(head, scan)
    values = hashlib.sha256(np.ascontiguousarray(head.hu).tobytes()).hexdigest()[:16]
    save_anatomy(sphere().with_(source=f"NRRD CT of 2×2×2 mm, values {values}, segmented at 0.7 mm"), out)
    assert main(["anatomy", "from-ct", str(scan), "-o", str(out), "--step-mm", "1", "--quiet"]) == 1
    assert "still holds the anatomy of an earlier run" in capfd.readouterr().out
    assert load_anatomy(out).name == sphere().name


def test_the_anatomy_of_another_scan_is_not_replaced(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    scan, out = tmp_path / "scan.nrrd", tmp_path / "nose"
    write_nrrd(head_without_nostrils(), scan)
    earlier = sphere().with_(source="NRRD CT of 2×2×2 mm, values 0123456789abcdef, segmented at 0.5 mm")
    save_anatomy(earlier, out)
    assert main(["anatomy", "from-ct", str(scan), "-o", str(out), "--quiet"]) == 2
    error = capfd.readouterr().err
    assert error.count("\n") == 1
    assert "one from NRRD CT of 2×2×2 mm, values 0123456789abcdef" in error
    assert load_anatomy(out).digest == earlier.digest


@pytest.mark.parametrize("what", ["nothing", "text", "one value"])
def test_what_is_no_scan_is_told_in_one_sentence(tmp_path: Path, capfd: pytest.CaptureFixture[str], what: str) -> None:
    scan, out = tmp_path / "scan.nrrd", tmp_path / "nose"
    if what == "text":
        scan.write_text("not a scan")
    elif what == "one value":
        write_nrrd(Volume(np.zeros((30, 30, 30), np.int16), np.eye(4)), scan)
    assert main(["anatomy", "from-ct", str(scan), "-o", str(out)]) == 2
    error = capfd.readouterr().err
    assert error.count("\n") == 1
    assert error.startswith("naris: expected ")
    assert not out.exists()


def test_a_folder_of_somebody_else_and_a_wrong_step_are_refused_first(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "mine.txt").write_text("mine")
    assert main(["anatomy", "from-ct", "absent.nrrd", "-o", str(tmp_path)]) == 2
    assert "mine.txt" in capfd.readouterr().err
    assert main(["anatomy", "from-ct", "absent.nrrd", "-o", str(tmp_path / "new"), "--step-mm", "3"]) == 2
    assert "between 0.2 and 1.0" in capfd.readouterr().err
