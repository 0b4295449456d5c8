"""What is kept of one anatomy is not lost to another."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from naris.anatomy.folder import load_anatomy, save_anatomy
from naris.cli import main
from tests.anatomy.shapes import tube


@pytest.fixture
def kept(tmp_path: Path) -> Path:
    folder = tmp_path / "patient"
    save_anatomy(tube().with_(source="a scan"), folder)
    (folder / "segmentation.seg.nrrd").write_text("of a scan")
    return folder


def test_another_anatomy_is_not_written_over_it(kept: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["anatomy", "builtin", "-o", str(kept), "--quiet"]) == 2
    assert "or one from naris.anatomy.builtin" in capfd.readouterr().err
    assert load_anatomy(kept, passages=False).source == "a scan"


def test_its_own_can_be_written_again(kept: Path) -> None:
    assert main(["anatomy", str(kept), "-o", str(kept), "--quiet"]) == 0


def test_transfer_keeps_to_it_before_any_work(kept: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    other = tmp_path / "other"
    save_anatomy(tube().with_(source="another scan"), other)
    assert main(["anatomy", "transfer", str(other), "-o", str(kept), "--quiet"]) == 2
    assert "one from a scan" in capfd.readouterr().err


def test_what_a_scan_was_warned_of_is_found_again(tmp_path: Path) -> None:
    from naris.cli.anatomies import findings_in

    assert findings_in(tmp_path) is None
    record = {"found": {"findings": [{"weight": "warning", "text": "the tip of the nose is cut"}]}}
    (tmp_path / "from_ct.json").write_text(json.dumps(record))
    assert findings_in(tmp_path) == "warning: the tip of the nose is cut"
