"""What a report is made from: plain values that `reproduce` and `demo` fill, and `write_report` turns into a page.

Every number of the page is computed from these; nothing is typed in. Shares are 0…1 (the page prints per cent),
positions in mm of the frame of the anatomy. Any tuple may be empty and any optional part None: the page leaves out
what is not there, and says so where a reader would miss it. How networks did on test sets stands in `report.scores`.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from jaxtyping import Float, UInt8

from naris.core.anatomy import Anatomy, RegionSet
from naris.core.results import Prediction
from naris.errors import InputError
from naris.report.scores import TestResult

NEIGHBOUR_MM, NEIGHBOUR_DEG = 2.0, 15.0
"""A test view nearer than both to a training view counts as its neighbour."""

LineRole = Literal["passage", "training", "test"]


@dataclass(frozen=True)
class Published:
    """A figure that somebody published for the same task, as shares."""

    accuracy: float
    std: float
    runs: int
    citation: str


SINHA_2018 = Published(
    accuracy=0.7653,
    std=0.0119,
    runs=5,
    citation="Sinha, Ishii, Taylor, Hager, Reiter (2018): Towards automatic initialization of registration algorithms"
    " using simulated endoscopy images, arXiv:1806.10748",
)


@dataclass(frozen=True, eq=False)
class Line:
    """A curve drawn over the picture of the anatomy: a centreline, or camera positions in order.

    Attributes:
        name: e.g. `trajectory 1`.
        role: `passage` (dashed), `training` or `test`.
        points_mm: (N, 3) in the frame of the anatomy.
    """

    name: str
    role: LineRole
    points_mm: Float[np.ndarray, "n 3"]


@dataclass(frozen=True, eq=False)
class AnatomyView:
    """The anatomy of the experiment.

    Attributes:
        anatomy: with the region set, and the passages if they are known.
        region_set: the name of the region set whose regions were told apart.
        texture: what coloured the walls, as a phrase, e.g. `the published texture (sampled_texture.jpg)`.
        lines: what to draw over the surface; empty draws the passages of the anatomy.
    """

    anatomy: Anatomy
    region_set: str
    texture: str | None = None
    lines: tuple[Line, ...] = ()

    @property
    def regions(self) -> RegionSet:
        return self.anatomy.region_set(self.region_set)


@dataclass(frozen=True, eq=False)
class ViewSet:
    """Example pictures of one kind, a few for each region.

    Attributes:
        title: e.g. `Training pictures`.
        caption: what they are, one or two sentences.
        images: one array (n, H, W, 3) uint8 for each region in order; n may be 0 and differ.
    """

    title: str
    caption: str
    images: tuple[UInt8[np.ndarray, "_ _ _ 3"], ...]


@dataclass(frozen=True, eq=False)
class NearestPair:
    """A test picture beside the training picture whose camera stood nearest to it, both (H, W, 3) uint8."""

    test: UInt8[np.ndarray, "h w 3"]
    training: UInt8[np.ndarray, "h w 3"]
    distance_mm: float
    angle_deg: float


@dataclass(frozen=True, eq=False)
class Split:
    """A way to choose test pictures.

    Attributes:
        key: `published`, `trajectory` or `trajectory_texture`, as in the names of figures; any other identifier works.
        label: short, for tables and charts, e.g. `published split`.
        phrase: in a sentence, e.g. `on the published split`; None makes it `on` and the label.
        explanation: one or two sentences: what the test pictures have in common with those of the training.
        count: test pictures.
        leaky: whether test views lie among the training views.
        nearest_mm: (N,) from each test camera to its nearest training camera (`report.nearest`), or None if unknown.
        nearest_deg: (N,) the angle between the viewing directions of these two.
        pair: a typical test picture beside its nearest training picture (the median pair is a fair choice).
    """

    key: str
    label: str
    explanation: str
    count: int
    leaky: bool
    nearest_mm: Float[np.ndarray, "n"] | None = None
    nearest_deg: Float[np.ndarray, "n"] | None = None
    pair: NearestPair | None = None
    phrase: str | None = None

    @property
    def called(self) -> str:
        return self.phrase or f"on {self.label}"


@dataclass(frozen=True, eq=False)
class TrainingCurve:
    """How the training of one run went.

    Attributes:
        seed: of the run.
        loss: (E,) mean training loss of each epoch (or of equal pieces of an endless stream).
        wall_s, cpu_s: how long it took; CPU over all threads.
    """

    seed: int
    loss: Float[np.ndarray, "e"]
    wall_s: float
    cpu_s: float


@dataclass(frozen=True, eq=False)
class NetworkResult:
    """One network, trained one way, on every test set.

    Attributes:
        key: `two_layer`, `compact` or `compact_at_will`, as in the names of figures; any other identifier works.
        label: short, for tables and charts, e.g. `compact, views at will`.
        phrase: in a sentence, e.g. `the compact network trained on views at will`; None makes `the compact network
            (views at will)` of the label `compact, views at will`.
        description: what the network is, one sentence.
        trained_on: what it learned from, one sentence.
        pictures: training pictures seen in all (with those of an endless stream), or None.
        parameters: number of weights.
        training: one curve a run.
        tests: one result a test set, in the order of `ReportData.splits`.
        step: what one point of the loss curves is, e.g. `epoch`.
    """

    key: str
    label: str
    description: str
    trained_on: str
    parameters: int
    training: tuple[TrainingCurve, ...]
    tests: tuple[TestResult, ...]
    pictures: int | None = None
    step: str = "epoch"
    phrase: str | None = None

    @property
    def called(self) -> str:
        kind, _, way = self.label.partition(", ")
        return self.phrase or f"the {kind} network" + (f" ({way})" if way else "")

    @property
    def at_will(self) -> bool:
        """Whether it learned from views drawn anew, not from the training pictures."""
        return self.key.endswith("at_will")

    def test(self, split: str) -> TestResult | None:
        """The result on that split, if it was measured."""
        return next((test for test in self.tests if test.split == split), None)


@dataclass(frozen=True, eq=False)
class LocatedFrame:
    """One picture that was located.

    Attributes:
        name: e.g. the file name.
        image: (H, W, 3) uint8.
        prediction: what the network said.
        localised: False where the honest answer is `not localised`.
        truth: the true region, None if nobody knows.
        position_error_mm, rotation_error_deg: of the predicted pose, None if there is none or nobody knows.
    """

    name: str
    image: UInt8[np.ndarray, "h w 3"]
    prediction: Prediction
    localised: bool
    truth: int | None = None
    position_error_mm: float | None = None
    rotation_error_deg: float | None = None


@dataclass(frozen=True)
class Stage:
    """One stage of the run: its name, what it made as a phrase, and how long it took (CPU over all threads).

    Seconds are None where nobody knows them, as after a run that was killed.
    """

    name: str
    made: str
    wall_s: float | None
    cpu_s: float | None


@dataclass(frozen=True, eq=False)
class ReportData:
    """Everything that stands in a report.

    Attributes:
        kind: which command made it; the summary at the top is worded for it.
        title: heading of the page.
        command: as typed.
        made: when, as text (ISO 8601, UTC); given, so that the page is a function of the data.
        anatomy: what was looked at.
        splits: the test sets.
        networks: results; the first is the one that the page speaks of first.
        views: example pictures.
        located: located pictures.
        published: a published figure to compare with, None if there is none for this anatomy.
        settings: section → setting → value, as `naris.core.provenance.plain` gives it (nested values are flattened).
        stages: timings.
        machine, versions, commit: from `naris.core.provenance`.
        seed: of the whole run.
    """

    kind: Literal["reproduce", "demo"]
    title: str
    command: str
    made: str
    anatomy: AnatomyView
    splits: tuple[Split, ...]
    networks: tuple[NetworkResult, ...]
    views: tuple[ViewSet, ...] = ()
    located: tuple[LocatedFrame, ...] = ()
    published: Published | None = None
    settings: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    stages: tuple[Stage, ...] = ()
    machine: Mapping[str, Any] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    commit: str | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        known = {split.key for split in self.splits}
        k = len(self.anatomy.regions.names)
        for network in self.networks:
            for test in network.tests:
                if test.split not in known:
                    raise InputError(
                        f"results on the splits {sorted(known)}", repr(test.split), "describe that split too"
                    )
                if test.confusion.shape != (k, k):
                    raise InputError(
                        f"confusion matrices ({k}, {k}) for the region set {self.anatomy.region_set}",
                        f"{test.confusion.shape} of {network.label}",
                        "name the region set that the network was trained for",
                    )

    def split(self, key: str) -> Split:
        return next(split for split in self.splits if split.key == key)

    def network(self, key: str) -> NetworkResult | None:
        """The result of that network, if it ran."""
        return next((network for network in self.networks if network.key == key), None)
