"""The cut of a scan beside an anatomy: it comes back as it was, and never that of another scan."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from naris.airway.block import Block
from naris.airway.cut import carry_cut, cut_path, read_cut, write_cut

SOURCE = "NRRD CT of 2×2×2 mm, values 0123456789abcdef, segmented at 0.5 mm"
OTHER = SOURCE.replace("0123", "abcd")
BOUNDS_MM = np.array([[-5.0, 0.0, 10.0], [5.0, 20.0, 20.0]])


def block() -> Block:
    hu = np.random.default_rng(0).integers(-1000, 2000, (80, 120, 90)).astype(np.float32)
    return Block(hu, np.array([-20.0, -18.3, 0.0]), 0.5)


def test_a_cut_has_the_values_of_the_scan_around_the_anatomy(tmp_path: Path) -> None:
    write_cut(block(), BOUNDS_MM, SOURCE, tmp_path)
    cut = read_cut(tmp_path, SOURCE)
    assert cut is not None and cut.step_mm == 0.5
    assert (cut.hu.shape < np.array(block().hu.shape)).all()
    for point_mm in (BOUNDS_MM[0] - 9, BOUNDS_MM[1], BOUNDS_MM.mean(axis=0)):
        assert cut.hu[tuple(cut.index(point_mm))] == block().hu[tuple(block().index(point_mm))]


def test_the_cut_of_another_scan_is_not_taken_and_goes(tmp_path: Path) -> None:
    write_cut(block(), BOUNDS_MM, SOURCE, tmp_path)
    assert read_cut(tmp_path, OTHER) is None
    assert read_cut(tmp_path, "the built-in nose") is None
    write_cut(block(), BOUNDS_MM, OTHER, tmp_path)
    assert list(tmp_path.iterdir()) == [cut_path(tmp_path, OTHER)]


def test_a_cut_is_carried_along(tmp_path: Path) -> None:
    one, other = tmp_path / "one", tmp_path / "other"
    one.mkdir(), other.mkdir()
    write_cut(block(), BOUNDS_MM, SOURCE, one)
    carry_cut(OTHER, one, other)
    assert not list(other.iterdir())
    carry_cut(SOURCE, one, other)
    carry_cut(SOURCE, one, one)
    assert read_cut(one, SOURCE) is not None and read_cut(other, SOURCE) is not None


def test_a_damaged_cut_is_told_and_left_out(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    (tmp_path / "scan-0123456789abcdef.nrrd").write_bytes(b"NRRD0004\nbroken")
    with caplog.at_level("WARNING", "naris"):
        assert read_cut(tmp_path, SOURCE) is None
    assert "the scan is not drawn" in caplog.text
