"""Which views `naris simulate` means: defaults, and trajectories for few and for many pictures."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from naris.anatomy.folder import save_anatomy
from naris.cli.simulate import Options
from naris.cli.views import simulation, spread
from naris.core.anatomy import NOWHERE, Passage
from naris.core.pose import Pose
from naris.dataset.generate import Simulation
from naris.render.viewpoints import Viewpoints
from tests.winding_tube import winding_tube


@pytest.fixture(scope="module")
def halves(tmp_path_factory) -> Path:
    """The tube with a passage to the middle from either end: to the regions one and two, and to four and three."""
    whole = winding_tube().passages[0]
    middle = len(whole.points_mm) // 2
    parts = {"front": slice(None, middle), "back": slice(None, middle, -1)}
    passages = [Passage(name, whole.points_mm[part], whole.clearance_mm[part]) for name, part in parts.items()]
    folder = tmp_path_factory.mktemp("anatomy") / "halves"
    save_anatomy(winding_tube().with_(passages=tuple(passages)), folder)
    return folder


def simulated(anatomy: Path, **options: object) -> Simulation:
    return simulation(Options(str(anatomy), Path("out"), **options))[0]


def test_what_is_not_given_is_as_the_help_says(tube: Path) -> None:
    free = simulated(tube).about("any")
    assert free == simulated(tube, count=1000, views="inspection").about("any")
    assert free["count"] == 1000
    steered = simulated(tube, views="trajectories", count=40).about("any")
    assert steered == simulated(tube, views="trajectories", count=40, step_mm=1.0, per_position=10).about("any")
    assert {key: steered["views"][key] for key in ("kind", "step_mm", "per_position")} == {
        "kind": "trajectories",
        "step_mm": 1.0,
        "per_position": 10,
    }


@pytest.mark.parametrize("count", [20, 40, 43, 80])
def test_a_few_views_on_trajectories_are_of_all_passages_and_regions(halves: Path, count: int) -> None:
    views = simulated(halves, views="trajectories", count=count).views
    assert len(views) == count
    np.testing.assert_array_equal(views.position, np.arange(count) // 10)
    assert set(views.trajectory) == {0, 1}
    assert len(set(views.region)) == min(4, count // 10)
    again = simulated(halves, views="trajectories", count=count).views
    np.testing.assert_array_equal(views.anatomy_T_camera.matrix, again.anatomy_T_camera.matrix)
    other = simulated(halves, views="trajectories", count=count, seed=1).views
    assert not np.array_equal(views.anatomy_T_camera.matrix, other.anatomy_T_camera.matrix)


def test_many_views_on_trajectories_are_of_passes_again_and_again(halves: Path) -> None:
    many, more = (simulated(halves, views="trajectories", count=count).views for count in (3000, 3500))
    np.testing.assert_array_equal(many.anatomy_T_camera.matrix, more.anatomy_T_camera.matrix[:3000])
    assert many.trajectory.max() > 2
    steps_mm = np.linalg.norm(np.diff(many.anatomy_T_camera.position_mm[::10], axis=0), axis=1)
    assert (steps_mm[np.diff(many.trajectory[::10]) == 0] < 1.01).all()


def walk(regions: list[int]) -> Viewpoints:
    """Two views at each of some positions, the first half of them on one trajectory."""
    n = len(regions)
    poses = Pose.of(np.tile(np.eye(3), (2 * n, 1, 1)), np.arange(6.0 * n).reshape(-1, 3), "LPS", "camera")
    views = Viewpoints.free(poses, np.repeat(regions, 2))
    return replace(views, trajectory=np.arange(2 * n) // n, position=np.repeat(np.arange(n), 2))


def test_positions_are_kept_evenly_over_regions_and_in_order() -> None:
    walked = walk([0] * 20 + [1] * 2 + [3] * 40)
    for wanted, shares in ((3, [1, 1, 0, 1]), (9, [4, 2, 0, 3]), (30, [14, 2, 0, 14]), (62, [20, 2, 0, 40])):
        kept = spread(walked, wanted)
        np.testing.assert_array_equal(np.bincount(kept.region, minlength=4) // 2, shares)
        np.testing.assert_array_equal(kept.position, np.repeat(np.arange(wanted), 2))
        place = kept.anatomy_T_camera.position_mm[:, 0]
        assert (np.diff(place) > 0).all()
    steps = np.diff(spread(walk([0] * 100), 7).anatomy_T_camera.position_mm[::2, 0])
    assert steps.max() - steps.min() <= 6.0 + 1e-9


def test_a_position_in_no_region_is_kept_only_where_the_others_are_too_few() -> None:
    walked = walk([0, NOWHERE, 0, 0])
    assert (spread(walked, 3).region == 0).all()
    assert len(spread(walked, 4)) == 8
