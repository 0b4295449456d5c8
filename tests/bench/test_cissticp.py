"""The runs of cisstICP: read as they were, at most as wrong as promised, without values where they are not given."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from naris.bench import BenchRequest, cissticp
from naris.bench.cissticp import CASES, FOLDER, GOALS_MM, MESH, Run
from naris.core.pose import Pose, distance
from naris.errors import InputError

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"


@pytest.fixture(scope="module")
def data() -> Path:
    if not (DATA / MESH).is_file():
        pytest.skip(f"no reference runs at {DATA / FOLDER}")
    return DATA


@pytest.fixture(scope="module")
def runs(data: Path) -> dict[str, Run]:
    return {case.name: cissticp.read_run(data / FOLDER, case) for case in CASES}


def test_the_noise_is_what_the_runs_were_told(runs: dict[str, Run]) -> None:
    for name, run in runs.items():
        off = run.points - run.true_points
        assert np.sqrt(np.square(off).mean()) == pytest.approx(1.0, abs=0.05)
        np.testing.assert_allclose(run.noise.covariance_mm2, np.tile(np.eye(3), (300, 1, 1)), atol=1e-9)
        if name != "imlp":
            minor = np.cross(run.normals, run.noise.major)
            spread = [np.std((axis * run.true_normals).sum(axis=1)) for axis in (run.noise.major, minor)]
            # Along the axes 1/(κ (1 ∓ eccentricity)) are the variances.
            expected = np.deg2rad(2.0) / np.sqrt([1 - run.noise.eccentricity, 1 + run.noise.eccentricity])
            np.testing.assert_allclose(spread, expected, rtol=0.1)


def test_the_starts_and_ends_of_the_peer_are_as_published(runs: dict[str, Run]) -> None:
    identity = Pose.identity(cissticp.FRAME, cissticp.CLOUD)
    for run in runs.values():
        assert np.rad2deg(distance(run.start, identity)[1]) == pytest.approx(9.79, abs=0.01)
    assert np.rad2deg(distance(runs["gimlop"].reached, identity)[1]) == pytest.approx(13.46, abs=0.01)


@pytest.mark.long
def test_the_errors_are_at_most_those_that_are_promised(data: Path) -> None:
    told = {one.name: one for one in cissticp.figures(BenchRequest(quick=True, scans=data))}
    for name, goal in GOALS_MM.items():
        figure = told[f"register.cissticp.{name}_mm"]
        assert figure.value is not None and figure.value <= goal
        assert figure.value == pytest.approx(told[f"register.cissticp.{name}.from_truth_mm"].value, abs=1e-3)
    assert (told["register.cissticp.worst_mm"].value or 1.0) <= cissticp.WORST_GOAL_MM
    assert told["register.cissticp.worst_mm"].peers["cisstICP"] == pytest.approx(19.43, abs=0.01)
    assert all(isinstance(one, (float, str)) for one in told["register.cissticp.imlp_mm"].peers.values())


def test_without_the_data_there_are_no_values(tmp_path: Path) -> None:
    for request in (BenchRequest(), BenchRequest(scans=tmp_path)):
        told = cissticp.figures(request)
        assert {one.name for one in told} >= {"register.cissticp.imlp_mm", "register.cissticp.worst_mm"}
        assert all(one.value is None and one.n == 0 for one in told)


def test_half_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the data of cisstICP, with SaveNoisySamples"):
        cissticp.read_run(tmp_path, CASES[1])
    (tmp_path / CASES[0].folder).mkdir()
    (tmp_path / CASES[0].folder / CASES[0].noisy).write_text("POINTS 2\n1 2 3\n")
    with pytest.raises(InputError, match="points and their normals in SaveNoisySamples"):
        cissticp.read_run(tmp_path, CASES[0])
