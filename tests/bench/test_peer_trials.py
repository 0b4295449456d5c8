"""Other solvers in our place: measured where the trials are given, said to be missing where they are not installed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from naris.bench import BenchRequest, in_our_place, peer_trials
from naris.bench.in_our_place import SOLVERS
from naris.bench.peer_trials import ASKED, NO_SCALE
from naris.bench.problems import SOLVED_POINTS
from naris.bench.trials import FROZEN, Trial, has_frozen
from naris.core.pose import CAMERA, Pose, distance
from naris.register.libraries import LIBRARIES, NOT_INSTALLED

DATA = Path(__file__).resolve().parents[3] / "shared" / "data"


@pytest.mark.parametrize("request_", [BenchRequest(), BenchRequest(quick=True, scans=DATA)])
def test_without_the_trials_or_the_time_there_are_no_values(request_: BenchRequest) -> None:
    told = peer_trials.figures(request_)
    asked = {f"{name.lower()}.{start}.{noise}" for name in SOLVERS for start, noise in ASKED}
    names = {f"register.peers.{one}.{what}" for one in asked for what in ("success", "cpu_s")}
    assert names | {f"register.peers.{name.lower()}.solve.cpu_ms" for name in LIBRARIES} == {one.name for one in told}
    assert all(one.value is None and one.n == 0 for one in told)


@pytest.mark.long
def test_all_who_are_there_get_the_same_trials(monkeypatch: pytest.MonkeyPatch) -> None:
    if not has_frozen(DATA):
        pytest.skip(f"no frozen trials at {DATA / FROZEN}")
    monkeypatch.setattr(peer_trials, "QUICK_TRIALS", 1)
    for room in (in_our_place, peer_trials):
        monkeypatch.setattr(room, "missing", lambda name: NOT_INSTALLED)
    told = {one.name: one for one in peer_trials.figures(BenchRequest(quick=True, scans=DATA, only="peers"))}
    for name in ("naris", "icp", "imlp"):
        for asked in ("region.b", "region.d", "none.d", "pose.b", "views3.b"):
            assert told[f"register.peers.{name}.{asked}.success"].n == 1
            assert (told[f"register.peers.{name}.{asked}.cpu_s"].value or 0) > 0
    assert told["register.peers.naris.views3.c.success"].n == 1
    scale = told["register.peers.icp.views3.c.success"]
    assert scale.value is None
    assert scale.peers == {"icp": NO_SCALE}
    missing = told["register.peers.open3d.region.d.success"]
    assert missing.value is None
    assert missing.peers == {"Open3D": NOT_INSTALLED}
    assert told["register.peers.open3d.solve.cpu_ms"].peers == {"Open3D": NOT_INSTALLED}


def test_a_solve_of_a_library_is_timed_from_poses_beside_the_truth(trial: Trial) -> None:
    clouds, begun = [], []

    def ready(points: np.ndarray):
        clouds.append(points)
        return lambda pose: begun.append(pose) or pose

    made = peer_trials._solve_figure("Open3D", ready, trial)
    assert made.value is not None and made.value > 0
    assert made.n == len(begun) - 1  # the first one warms up
    assert [len(points) for points in clouds] == [SOLVED_POINTS]
    truth = trial.anatomy_T_camera
    assert all(distance(Pose(pose, truth.target, CAMERA), truth)[0] <= 2 for pose in begun)
