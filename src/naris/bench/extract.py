"""The figures of a report, under the names that issues and documents use."""

from __future__ import annotations

from naris.bench.result import Figure, Peer
from naris.report.data import NetworkResult, Published, ReportData
from naris.report.scores import TestResult

GOALS = {
    "reproduce.compact.trajectory.accuracy": 0.50,
    "reproduce.compact.at_will.accuracy": 0.93,
    "reproduce.two_layer.training_seconds": 45 * 60.0,
    "demo.region_accuracy": 0.85,
}
DEMO_GOAL_S = 300.0
AT_WILL = "compact_at_will"
_AT_WILL_SPLIT = "trajectory_texture"


def reproduce_figures(data: ReportData) -> tuple[Figure, ...]:
    """Accuracy, non-neighbour errors and calibration of every network on every split; shares are 0…1.

    `reproduce.<network>.<split>.accuracy`, `.accuracy_std` (between runs, where there are several),
    `.nonneighbour_error` (share of the wrong answers; without a value where there are none) and `.ece`; for the network
    trained on views at will, `reproduce.compact.at_will.…` is `trajectory_texture`; other splits add theirs.
    `reproduce.<network>.training_seconds` is the wall clock of all its runs, over all calls that worked on them; it is
    left out where that is not known.
    """
    figures = [
        figure for network in data.networks for test in network.tests for figure in _of_test(data, network, test)
    ]
    for network in data.networks:
        spent = [stage for stage in data.stages if stage.name == f"train: {network.label}"]
        runs, name = len(network.training), f"reproduce.{_base(network)}.training_seconds"
        figures += [
            Figure(name, stage.wall_s, "s", runs, "lower", GOALS.get(name))
            for stage in spent
            if stage.wall_s is not None
        ]
    return tuple(figures)


def _base(network: NetworkResult) -> str:
    return "compact.at_will" if network.key == AT_WILL else network.key


def demo_figures(data: ReportData, wall_s: float | None) -> tuple[Figure, ...]:
    """Accuracy on the last test set of the first network (the hardest), and how long everything took (wall clock).

    Without `wall_s` nobody knows how long, and `demo.seconds` is left out.
    """
    test = data.networks[0].tests[-1]
    name = "demo.region_accuracy"
    accuracy = Figure(name, test.mean, "1", _count(test), "higher", GOALS[name], test.interval)
    figures = [accuracy]
    pictures = data.networks[0].pictures
    if pictures is not None:  # how much it could learn in its time: without it two runs cannot be compared
        figures.append(Figure("demo.training_pictures", float(pictures), "pictures", 1, "higher"))
    if wall_s is not None:
        figures.append(Figure("demo.seconds", wall_s, "s", 1, "lower", DEMO_GOAL_S))
    if test.pose is not None:
        figures.append(Figure("demo.position_median_mm", test.pose.median_mm, "mm", _count(test), "lower"))
    return tuple(figures)


def _of_test(data: ReportData, network: NetworkResult, test: TestResult) -> list[Figure]:
    base = f"reproduce.{_base(network)}.{test.split}"
    if network.key == AT_WILL and test.split == _AT_WILL_SPLIT:
        base = f"reproduce.{_base(network)}"
    n, name = _count(test), f"{base}.accuracy"
    peers = _peers(data.published) if data.published and data.split(test.split).leaky and not network.at_will else {}
    far = test.nonneighbour_error(data.anatomy.regions.neighbours)
    figures = [
        Figure(name, test.mean, "1", n, "higher", GOALS.get(name), test.interval, peers),
        Figure(f"{base}.nonneighbour_error", far, "1", test.wrong, "lower"),
    ]
    if test.std is not None:
        figures.append(Figure(f"{base}.accuracy_std", test.std, "1", len(test.runs), "lower"))
    if test.calibration is not None:
        figures.append(Figure(f"{base}.ece", test.calibration.ece, "1", n, "lower"))
    return figures


def _peers(published: Published) -> dict[str, Peer]:
    return {"published": published.accuracy}


def _count(test: TestResult) -> int:
    """Answers behind the figure: pictures times runs."""
    return sum(run.count for run in test.runs)
