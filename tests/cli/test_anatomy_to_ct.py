"""`naris anatomy to-ct`: a scan of a known anatomy that reads back where it lies; and what it refuses."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import trimesh

from naris.anatomy.folder import save_anatomy
from naris.cli import main
from naris.ct.read import read_scan
from tests.winding_tube import centre_line, winding_tube


@pytest.fixture
def tube(tmp_path: Path) -> Path:
    folder = tmp_path / "tube"
    save_anatomy(winding_tube(), folder)
    return folder


@pytest.mark.parametrize("name", ["scan.nrrd", "series"])
def test_the_scan_has_air_where_the_lumen_is(
    tube: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str
) -> None:
    out = tmp_path / name
    asked = ["--spacing-mm", "1", "1", "2", "--noise-hu", "10", "--json", "--quiet"]
    assert main(["anatomy", "to-ct", str(tube), "-o", str(out), *asked]) == 0
    told = json.loads(capfd.readouterr().out)
    scan = read_scan(out).volume
    assert list(scan.shape) == told["shape"]
    np.testing.assert_allclose(scan.spacing_mm, told["spacing_mm"])
    middle = np.rint(scan.index(centre_line()[::20])).astype(int)
    beside = np.rint(scan.index(centre_line()[::20] + [9.0, 0, 0])).astype(int)
    assert (scan.hu[tuple(middle.T)] < -800).all()
    assert (scan.hu[tuple(beside.T)] > -200).all()


def test_the_seed_decides_the_noise(tube: Path, tmp_path: Path) -> None:
    asked = ["anatomy", "to-ct", str(tube), "--spacing-mm", "2", "2", "2", "--quiet"]
    for name, seed in (("a", "1"), ("b", "1"), ("c", "2")):
        assert main([*asked, "-o", str(tmp_path / f"{name}.nrrd"), "--seed", seed]) == 0
    one, same, other = ((tmp_path / f"{name}.nrrd").read_bytes() for name in "abc")
    assert one == same
    assert b"#" not in one.partition(b"\n\n")[0]  # a comment would tell the second of writing
    assert one != other


@pytest.mark.parametrize(
    ("option", "says"),
    [
        (["--tilt-deg", "40"], "at most 30°"),
        (["--spacing-mm", "0", "1", "1"], "above 0"),
        (["--metal", "-1"], "0 or more"),
        (["--noise-hu", "nan"], "0 or more"),
    ],
)
def test_impossible_scanners_are_refused_and_write_nothing(
    tube: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str], option: list[str], says: str
) -> None:
    assert main(["anatomy", "to-ct", str(tube), "-o", str(tmp_path / "scan.nrrd"), *option]) == 2
    error = capfd.readouterr().err
    assert says in error
    assert error.count("\n") == 1
    assert not (tmp_path / "scan.nrrd").exists()


def test_a_folder_with_slices_of_another_series_is_refused_first(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "0000.dcm").write_bytes(b"")
    assert main(["anatomy", "to-ct", "absent.ply", "-o", str(tmp_path)]) == 2
    assert "new or empty folder" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("name", "says"),
    [("scan.nrrd", "a new file"), ("scan.nii.gz", "ends in .nrrd"), ("scan.mha", "ends in .nrrd")],
)
def test_nothing_is_written_over_and_no_other_kind_of_file_promised(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], name: str, says: str
) -> None:
    (tmp_path / "scan.nrrd").write_bytes(b"a patient's")
    assert main(["anatomy", "to-ct", "absent.ply", "-o", str(tmp_path / name)]) == 2
    assert says in capfd.readouterr().err
    assert (tmp_path / "scan.nrrd").read_bytes() == b"a patient's"
    assert len(list(tmp_path.iterdir())) == 1


def test_no_name_of_a_file_gets_into_a_series(tmp_path: Path) -> None:
    named, series = tmp_path / "JOHN_DOE.ply", tmp_path / "series"
    mesh = winding_tube()
    trimesh.Trimesh(mesh.vertices_mm, mesh.faces, process=False).export(named)
    asked = ["--spacing-mm", "4", "4", "20", "--quiet"]
    assert main(["anatomy", "to-ct", str(named), "-o", str(series), *asked]) == 0
    for path in series.iterdir():
        assert b"JOHN" not in path.read_bytes()
