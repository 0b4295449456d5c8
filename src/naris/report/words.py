"""Sentences of the report, each chosen by the numbers that it speaks of."""

from __future__ import annotations

import math

import numpy as np

from naris.report.data import NEIGHBOUR_DEG, NEIGHBOUR_MM, SINHA_2018, NetworkResult, Published, ReportData, Split
from naris.report.scores import Calibration, TestResult

LARGE_DROP = 0.10
"""A difference of accuracy between a leaky and a clean split that deserves a word."""
NEAR_CHANCE = 0.05
UNCALIBRATED = 0.10

_NUMBERS = ("none", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


def share(value: float) -> str:
    """A share in per cent with one decimal."""
    return f"{100 * value:.1f}\u00a0%"


def _printed(value: float) -> float:
    return round(100 * value, 1)


def spread(mean: float, std: float | None) -> str:
    """Mean and standard deviation in per cent."""
    return share(mean) if std is None else f"{100 * mean:.1f}\u00a0±\u00a0{100 * std:.1f}\u00a0%"


def reach(values: list[float]) -> str:
    """The range of shares, or the one that they agree on."""
    low, high = f"{100 * min(values):.1f}", f"{100 * max(values):.1f}"
    return f"{low}\u00a0%" if low == high else f"{low} to {high}\u00a0%"


def seconds(value: float) -> str:
    """A duration as people say it."""
    if value < 10:
        return f"{value:.1f}\u00a0s"
    if value < 120:
        return f"{value:.0f}\u00a0s"
    minutes = value / 60
    return f"{minutes:.0f}\u00a0min" if minutes < 100 else f"{minutes / 60:.1f}\u00a0h"


def listed(words: list[str]) -> str:
    """`a, b and c`."""
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} and {words[-1]}"


def counted(count: int) -> str:
    """Small numbers in words."""
    return _NUMBERS[count] if count < len(_NUMBERS) else f"{count:,}"


def many(count: int, noun: str) -> str:
    """`one run`, `five runs`, `1,270 pictures`."""
    return f"{counted(count)}\u00a0{noun}{'' if count == 1 else 's'}"


def capital(text: str) -> str:
    """The text with its first letter large."""
    return text[:1].upper() + text[1:]


def lede(data: ReportData) -> str:
    """The outcome in two or three sentences; a demo begins with what its network can do."""
    if not data.networks:
        return "Nothing was trained or tested."
    parts = [_leak_in_short(data), _best_in_short(data)]
    if data.kind == "demo":
        parts.reverse()
    return " ".join([*(part for part in parts if part), "All pictures are simulated."])


def _leak_in_short(data: ReportData) -> str | None:
    for network in data.networks:
        leaky, clean = _by_kind(data, network)
        if not leaky or not clean:
            continue
        a, b = leaky[0], clean[0]
        said = (
            f"{capital(data.split(a.split).called)}, {network.called} names the right region in {share(a.mean)} of the "
            f"pictures; {data.split(b.split).called}, in {share(b.mean)}."
        )
        if a.mean - b.mean > LARGE_DROP and not network.at_will:
            said += " The first figure mostly tells how well it interpolates between near-duplicate views."
        return said
    return None


def _best_in_short(data: ReportData) -> str | None:
    hardest = [(network, test) for network in data.networks if (test := hardest_test(data, network)) is not None]
    if not hardest:
        return None
    network, test = max(hardest, key=lambda pair: pair[1].mean)
    return (
        f"{capital(data.split(test.split).called)}, {network.called} names the right one of "
        f"{counted(len(data.anatomy.regions.names))} regions in {share(test.mean)} of the pictures (always naming the "
        f"commonest would score {share(test.chance)})."
    )


def done(data: ReportData) -> list[str]:
    """What was done."""
    view = data.anatomy
    names = view.regions.names
    texture = f", walls coloured by {view.texture}" if view.texture else ""
    said = [
        f"Endoscopic pictures were simulated inside one anatomy ({view.anatomy.name}{texture}). The camera carries its "
        "own light and moves through the hollow of the nose; its true pose is known for every picture.",
        "A network sees one picture and nothing else, and names the region in which the camera stands, one of "
        f"{counted(len(names))}: {listed(list(names))}.",
    ]
    for network in data.networks:
        runs = len(network.training) or max((len(t.runs) for t in network.tests), default=0)
        trained = f" Trained {counted(runs)} times, from different seeds." if runs > 1 else " Trained once."
        said.append(f"{capital(network.called)}: {network.description} {network.trained_on}{trained if runs else ''}")
    if data.published:
        said.append(f"This repeats the experiment of {data.published.citation}.")
    elif data.kind == "demo" and any(split.key == "published" for split in data.splits):
        said.append(f"“Published” on this page refers to the experiment of {SINHA_2018.citation}.")
    elif data.kind == "reproduce":
        said.append(
            f"This is modelled on the experiment of {SINHA_2018.citation}; with another anatomy, texture, number of "
            "pictures or length of training, their figure is no measure for it and is left out."
        )
    return said


def came_out(data: ReportData) -> list[str]:
    """What came out, the leaky figures beside the clean ones."""
    tested = [network for network in data.networks if network.tests]
    said = [_line(data, network) for network in tested]
    tests = [test for network in tested for test in network.tests]
    if tests:
        low = [n.called for n in tested for t in _by_kind(data, n)[1] if at_chance(t)]
        beside = f"; {listed(list(dict.fromkeys(low)))} does no better than that on a clean split" if low else ""
        said.append(f"Always naming the commonest region would score {reach([t.chance for t in tests])}{beside}.")
        neighbours = data.anatomy.regions.neighbours
        far = [rate for test in tests if (rate := test.nonneighbour_error(neighbours)) is not None]
        if far:
            said.append(f"Of the wrong answers, {reach(far)} name a region that does not touch the true one.")
    posed = [network for network in tested if network.tests[-1].pose is not None]
    said += [_pose(data, network) for network in posed[-1:]]
    if data.located:
        said.append(_located(data))
    return said


def trust(data: ReportData) -> list[str]:
    """How far the numbers can be trusted."""
    said = [*leak(data), *calibration(data)]
    said += [
        "Every picture, for training and for testing, is simulated. Real endoscopy has blood, mucus, fog, motion, "
        "glare, and tissue that moves; none of these figures says how well a network does there.",
        f"Training and testing share one anatomy ({data.anatomy.anatomy.name}). Nothing here says how well a network "
        "does in another nose.",
    ]
    counts = sorted({test.runs[0].count for network in data.networks for test in network.tests})
    if counts:
        size = f"{counts[0]:,}" if len(counts) == 1 else f"{counts[0]:,} to {counts[-1]:,}"
        said.append(
            f"Each test set holds {size}\u00a0pictures. The intervals count the near-copies of one camera position "
            "together; neighbouring positions still resemble each other, so they are rather too narrow than too wide."
        )
    once = [n.called for n in data.networks if n.tests and all(len(test.runs) == 1 for test in n.tests)]
    if once:
        was = "was" if len(once) == 1 else "were each"
        said.append(f"{capital(listed(once))} {was} trained only once: how much luck was in it is unknown.")
    said.append("For research only: this is no medical device and must not guide a procedure.")
    return said


def leak(data: ReportData) -> list[str]:
    """What the difference between leaky and clean splits means, for every network that has both."""
    said: list[str] = []
    near_told = False
    for network in data.networks:
        leaky, clean = _by_kind(data, network)
        if not leaky or not clean:
            continue
        split, own = data.split(leaky[0].split), clean[0]
        drop = leaky[0].mean - own.mean
        had, left = f"{share(leaky[0].mean)} {split.called}", f"{share(own.mean)} {data.split(own.split).called}"
        # Views at will are drawn anew: what lies near to the training pictures tells nothing of them.
        near = "" if near_told or network.at_will else _near(split)
        near_told = near_told or not network.at_will
        if drop > LARGE_DROP:
            meaning = (
                "its views keep away from the clean test's, and not from those of the leaky one."
                if network.at_will
                else f"the {split.label} measures interpolation between near-duplicate views, not localisation."
            )
            said.append(f"{capital(network.called)} falls from {had} to {left}: {meaning}{near}")
        elif drop < -LARGE_DROP:
            said.append(
                f"{capital(network.called)} has {had} and {left}: the clean test is the easier one, which is odd.{near}"
            )
        else:
            # Of the figures as they stand there, so that the reader's subtraction agrees.
            points = f"{abs(_printed(leaky[0].mean) - _printed(own.mean)):.1f} points apart"
            meaning = f"{points}, so that little of its figure rests on near-duplicate views."
            said.append(f"{capital(network.called)} has {had} and {left}, {meaning}{near}")
    return said


def calibration(data: ReportData) -> list[str]:
    """Whether the probabilities of each network may be taken at their word, on its hardest test set."""
    honest: list[str] = []
    bold: list[str] = []
    shy: list[str] = []
    for network in data.networks:
        judged: list[tuple[TestResult, Calibration]] = [
            (test, known) for test in network.tests if (known := test.calibration) is not None
        ]
        if not judged:
            continue
        test, worst = max(judged, key=lambda pair: pair[1].ece)
        if worst.ece <= UNCALIBRATED:
            honest.append(f"{network.called} (expected calibration error at most {worst.ece:.3f})")
        else:
            where = data.split(test.split).called
            told = f"{network.called} ({share(worst.mean_confidence)} sure, right in {share(test.mean)}, {where})"
            (bold if worst.mean_confidence > test.mean else shy).append(told)
    said = []
    if honest:
        said.append(f"Probabilities close to the share of right answers, on average: {listed(honest)}.")
    if bold:
        said.append(f"Too sure of itself: {listed(bold)}.")
    if shy:
        said.append(f"Less sure than it could be: {listed(shy)}.")
    return said


def short_training(network: NetworkResult) -> str | None:
    """Says so where no run has more than one value of its loss, which is no curve."""
    if any(len(run.loss) > 1 for run in network.training):
        return None
    values = listed([f"{run.loss[0]:.3g}" for run in network.training if len(run.loss)] or ["none"])
    return f"The training was too short for a curve: each run has one value only ({values}), for all its steps."


def against_published(test: TestResult, published: Published) -> str:
    """`in line with`, `above` or `below` the published figure, by twice the joint standard deviation."""
    margin = 2 * math.hypot(published.std, test.std or 0.0)
    if abs(test.mean - published.accuracy) <= margin:
        return "in line with"
    return "above" if test.mean > published.accuracy else "below"


def at_chance(test: TestResult) -> bool:
    """Whether the accuracy cannot be told from always naming the commonest region."""
    low = test.interval[0] if test.interval else test.mean - NEAR_CHANCE
    return low <= test.chance


def hardest_test(data: ReportData, network: NetworkResult) -> TestResult | None:
    """The result on the last clean split: they stand in the order of how much of them is unseen."""
    clean = _by_kind(data, network)[1]
    return clean[-1] if clean else None


def main_tests(data: ReportData, network: NetworkResult) -> list[TestResult]:
    """What to speak of first: the hardest clean test, before it a leaky and a clean one of the first that has both."""
    leaky, clean = _by_kind(data, network)
    first = next((n for n in data.networks if all(_by_kind(data, n))), None)
    if network is not first:
        return clean[-1:] or leaky[:1]
    return [leaky[0], clean[0], *(clean[-1:] if len(clean) > 1 else [])]


def _by_kind(data: ReportData, network: NetworkResult) -> tuple[list[TestResult], list[TestResult]]:
    """Tests on leaky splits, and on clean ones. Views at will keep away from the views of the clean splits only."""
    leaky = [test for test in network.tests if data.split(test.split).leaky]
    return leaky, [test for test in network.tests if test not in leaky]


def _line(data: ReportData, network: NetworkResult) -> str:
    parts = []
    for test in network.tests:
        split = data.split(test.split)
        said = f"{spread(test.mean, test.std)} {split.called}"
        if data.published and split.leaky and not network.at_will:
            figure = spread(data.published.accuracy, data.published.std)
            said += f" ({against_published(test, data.published)} the published {figure})"
        parts.append(said)
    return f"{capital(network.called)} is right in {listed(parts)}."


def _pose(data: ReportData, network: NetworkResult) -> str:
    test = network.tests[-1]
    pose = test.pose
    if pose is None:
        return ""
    return (
        f"{capital(network.called)} also estimates the pose of the camera: {data.split(test.split).called}, half of "
        f"the pictures are within {pose.median_mm:.1f}\u00a0mm, half within {pose.median_deg:.1f}°, and "
        f"{share(pose.share_within(4, 15))} within both 4\u00a0mm and 15°."
    )


def _located(data: ReportData) -> str:
    answered = [frame for frame in data.located if frame.localised]
    known = [frame for frame in answered if frame.truth is not None]
    right = sum(frame.prediction.region == frame.truth for frame in known)
    parts = []
    if known:
        parts.append(f"{counted(right)} in the right region and {counted(len(known) - right)} in a wrong one")
    if len(answered) > len(known):
        parts.append(f"{counted(len(answered) - len(known))} whose truth nobody knows")
    if len(data.located) > len(answered):
        parts.append(f"{counted(len(data.located) - len(answered))} for which the honest answer was “not localised”")
    return f"Located as examples, drawn at random from each region: {', '.join(parts)}."


def _near(split: Split) -> str:
    if split.nearest_mm is None or split.nearest_deg is None:
        return ""
    mm, deg = float(np.median(split.nearest_mm)), float(np.median(split.nearest_deg))
    close = float(((split.nearest_mm <= NEIGHBOUR_MM) & (split.nearest_deg <= NEIGHBOUR_DEG)).mean())
    return (
        f" {capital(split.called)}, the median test view stands {mm:.1f}\u00a0mm from a training view and is turned by "
        f"{deg:.1f}°; {share(close)} have one within both {NEIGHBOUR_MM:g}\u00a0mm and {NEIGHBOUR_DEG:g}°."
    )
