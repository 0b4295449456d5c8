"""What a network learns from: a fixed set of pictures, or a stream of views that never ends."""

from __future__ import annotations

from collections.abc import Generator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from naris.core.anatomy import Anatomy, RegionSet
from naris.core.camera import Intrinsics
from naris.core.pose import Pose, fingerprints
from naris.core.provenance import digest, plain
from naris.dataset.read import Dataset
from naris.dataset.stream import Batch, SeveralStreams
from naris.errors import DatasetError
from naris.model.checkpoint import Subject
from naris.model.localizer import fitted, input_px, squared
from naris.render.near import neighbours
from naris.train.augment import augment
from naris.train.config import Replay, TrainConfig
from naris.train.strangers import strangers

_ORDER, _CHANGE, _RECALL, _STRANGE = 1, 2, 3, 4  # what a random number is for; keeps the uses independent
_MARGIN = 1.3  # fixed pictures are kept a little larger than the input, so that turning them loses no detail


@runtime_checkable
class Stream(Protocol):
    """Views by number, as `naris.dataset.stream.ViewStream` gives them."""

    @property
    def anatomy(self) -> Anatomy: ...

    @property
    def regions(self) -> RegionSet: ...

    @property
    def intrinsics(self) -> Intrinsics: ...

    @property
    def avoid(self) -> Pose | None:
        """Views that stay unseen."""
        ...

    def batch(self, index: int, size: int) -> Batch:
        """The same bits for the same index and size."""
        ...

    def steered(self, positions: int, per_position: int) -> Batch:
        """What a camera sees that is steered through the passages; a RegionError if none can be."""
        ...


@dataclass(frozen=True, eq=False)
class Examples:
    """A fixed set of N pictures with their truth.

    Attributes:
        images: (N, H, W, 3) uint8, RGB.
        region: (N,) labels.
        anatomy_T_camera: (N,) poses.
        subject: what they show.
        group: (N,) number of the trajectory; pictures of one group are never on both sides of a split.

    Raises:
        DatasetError: if the numbers of pictures, labels and poses differ, there are none, or a label is no region.
    """

    images: UInt8[np.ndarray, "n h w 3"]
    region: Int[np.ndarray, "n"]
    anatomy_T_camera: Pose
    subject: Subject
    group: Int[np.ndarray, "n"] | None = None

    def __post_init__(self) -> None:
        counts = {len(self.images), len(self.region), len(self.anatomy_T_camera)}
        k = len(self.subject.regions.names)
        if len(counts) != 1 or 0 in counts:
            raise DatasetError("as many labels and poses as pictures", f"{sorted(counts)}", "check the data set")
        if self.region.min() < 0 or self.region.max() >= k:
            raise DatasetError(
                f"labels of the {k} regions of {self.subject.regions.name!r}",
                f"{self.region.min()}…{self.region.max()}",
                "leave out the pictures that lie in no region",
            )

    @staticmethod
    def of(dataset: Dataset) -> Examples:
        """All pictures of a data set on disk.

        Raises:
            DatasetError: if a picture lies in no region.
            ImageError: if a picture cannot be read.
        """
        subject = Subject(
            dataset.regions,
            dataset.anatomy_name or "unknown",
            dataset.anatomy_digest,
            dataset.anatomy_T_camera.target,
            dataset.intrinsics,
        )
        return Examples(dataset.images(), dataset.labels, dataset.anatomy_T_camera, subject, dataset.views.trajectory)

    def __len__(self) -> int:
        return len(self.region)

    def __getitem__(self, index: Int[np.ndarray, "m"] | Bool[np.ndarray, "n"] | slice) -> Examples:
        group = None if self.group is None else self.group[index]
        return Examples(self.images[index], self.region[index], self.anatomy_T_camera[index], self.subject, group)


@dataclass(frozen=True, eq=False)
class Lesson:
    """What the network is shown in one step: B pictures of its world, then S of others.

    Attributes:
        images: (B + S, s, s, 3) uint8.
        region: (B,) labels.
        pose: (B, 4, 4) `anatomy_T_camera`, mm.
    """

    images: UInt8[np.ndarray, "n s s 3"]
    region: Int[np.ndarray, "b"]
    pose: Float[np.ndarray, "b 4 4"]


@runtime_checkable
class Lessons(Protocol):
    """Where lessons come from: lesson `step` depends on the configuration, the data and `step` alone."""

    subject: Subject
    identity: str
    """Tells these data from others."""

    @property
    def told(self) -> dict[str, object]:
        """What a model remembers of them."""
        ...

    @property
    def per_epoch(self) -> int:
        """Lessons in a pass through the data, or those that are reported together."""
        ...

    def lesson(self, step: int) -> Lesson: ...

    def positions_mm(self) -> Float[np.ndarray, "n 3"]:
        """Some camera positions, for their mean and spread."""
        ...


class FixedLessons:
    """From a fixed set: every picture once in each epoch, in an order of its own.

    A lesson has `config.batch` pictures, the last of an epoch those that are left; one that is left alone joins the
    lesson before, because the network is normalised over a lesson and one picture has no spread.

    Raises:
        DatasetError: if there is only one picture.
    """

    def __init__(self, examples: Examples, config: TrainConfig) -> None:
        if len(examples) < 2:
            raise DatasetError("at least 2 pictures to learn from", f"{len(examples)}", "make a larger data set")
        self.examples, self.config = examples, config
        intrinsics = examples.subject.intrinsics.squared()
        self.subject = replace(examples.subject, intrinsics=intrinsics)
        size = input_px(config.network)
        images = squared(examples.images)
        if config.augmentation is not None and images.shape[1] > _MARGIN * size:
            images = fitted(images, round(_MARGIN * size))
        elif config.augmentation is None:
            images = fitted(images, size)
        self._images = images
        self._fov_deg = np.full(config.batch + 1, intrinsics.vertical_fov_deg)
        self.identity = digest(
            [examples.subject.identity(), examples.images, examples.region, examples.anatomy_T_camera.matrix]
        )

    @property
    def told(self) -> dict[str, object]:
        known = fingerprints(self.examples.anatomy_T_camera)
        return {"kind": "data set", "pictures": len(self.examples), "views": known}

    @property
    def per_epoch(self) -> int:
        whole, left = divmod(len(self.examples), self.config.batch)
        return max(whole + (left > 1), 1)

    def positions_mm(self) -> Float[np.ndarray, "n 3"]:
        return self.examples.anatomy_T_camera.position_mm

    def lesson(self, step: int) -> Lesson:
        epoch, place = divmod(step, self.per_epoch)
        order = np.random.default_rng([self.config.seed, _ORDER, epoch]).permutation(len(self.examples))
        is_last = place == self.per_epoch - 1
        chosen = order[place * self.config.batch : None if is_last else (place + 1) * self.config.batch]
        pose = self.examples.anatomy_T_camera.matrix[chosen]
        fov_deg = self._fov_deg[: len(chosen)]
        shown = _Shown(self._images[chosen], self.examples.region[chosen], pose, fov_deg, self.subject.intrinsics)
        return _changed(shown, self.config, step)


class StreamLessons:
    """From a stream: each lesson is drawn from the last few batches, which are made as they are needed."""

    def __init__(self, stream: Stream, config: TrainConfig) -> None:
        self.stream, self.config = stream, config
        self.subject = _subject_of(stream)
        self._replay = config.replay or Replay(times=1, memory=1)
        self._known: dict[int, Batch] = {}
        self.identity = digest([self.subject.identity(), stream_description(stream)])

    @property
    def told(self) -> dict[str, object]:
        stream = self.stream
        parts = stream.parts if isinstance(stream, SeveralStreams) else (stream,)
        views = [getattr(getattr(part, "bank", None), "distribution", None) for part in parts]
        steered = [getattr(part, "steered_share", 0.0) for part in parts]
        told = {"kind": "views at will", "anatomies": len(parts), "views": plain(views[0])}
        told["source"] = digest([self.subject.identity(), _unseeded(stream_description(stream))])
        return told | ({"steered_share": steered[0]} if steered[0] else {})

    @property
    def per_epoch(self) -> int:
        return 100

    def positions_mm(self) -> Float[np.ndarray, "n 3"]:
        first = [self._batch(i).anatomy_T_camera.position_mm for i in range(min(4, self._replay.memory))]
        return np.concatenate(first)

    def lesson(self, step: int) -> Lesson:
        newest = step // self._replay.times
        oldest = max(newest - self._replay.memory + 1, 0)
        for index in [index for index in self._known if index < oldest]:
            del self._known[index]
        size = self.config.batch
        if self.config.replay is None:
            which, row = np.full(size, newest), np.arange(size)
        else:
            # At the start there is little to remember: the first lessons draw from the first batch alone.
            rng = np.random.default_rng([self.config.seed, _RECALL, step])
            which, row = rng.integers(oldest, newest + 1, size), rng.integers(0, size, size)
        batches = {index: self._batch(index) for index in sorted(set(which.tolist()))}
        pick = [(batches[index], r) for index, r in zip(which.tolist(), row.tolist(), strict=True)]
        images = np.stack([batch.images[r] for batch, r in pick])
        region = np.array([batch.region[r] for batch, r in pick])
        pose = np.stack([batch.anatomy_T_camera.matrix[r] for batch, r in pick])
        fov_deg = np.array([batch.vertical_fov_deg[r] for batch, r in pick])
        fov_deg = self._squared_fov_deg(fov_deg)
        shown = _Shown(squared(images), region, pose, fov_deg, self.subject.intrinsics, self.stream.avoid)
        return _changed(shown, self.config, step)

    def _squared_fov_deg(self, fov_deg: Float[np.ndarray, "b"]) -> Float[np.ndarray, "b"]:
        """Vertical angles of the squares in the middle of the stream's pictures, from those of the whole pictures."""
        whole, part = self.stream.intrinsics.height, self.subject.intrinsics.height
        if part == whole:
            return fov_deg
        return np.rad2deg(2 * np.arctan(np.tan(np.deg2rad(fov_deg) / 2) * part / whole))

    def _batch(self, index: int) -> Batch:
        if index not in self._known:
            self._known[index] = self.stream.batch(index, self.config.batch)
        return self._known[index]


def _subject_of(stream: Stream) -> Subject:
    """Of one anatomy; of several no anatomy in particular, and no borders where these differ from one to the next."""
    subject = Subject.of(stream.anatomy, stream.regions, stream.intrinsics.squared())
    if not isinstance(stream, SeveralStreams):
        return subject
    borders = subject.borders if len({digest(part.regions) for part in stream.parts}) == 1 else None
    return replace(subject, anatomy_digest=None, borders=borders)


def lessons_of(data: Examples | Stream, config: TrainConfig) -> Lessons:
    """The lessons of a fixed set or a stream."""
    return FixedLessons(data, config) if isinstance(data, Examples) else StreamLessons(data, config)


def lessons_from(lessons: Lessons, first: int, ahead: int) -> Generator[Lesson]:
    """Lessons `first`, `first` + 1, … without end, the next `ahead` of them made on a thread meanwhile."""
    with ThreadPoolExecutor(1, thread_name_prefix="lessons") as pool:
        coming: list[Future[Lesson]] = []
        try:
            while True:
                while len(coming) <= ahead:
                    coming.append(pool.submit(lessons.lesson, first))
                    first += 1
                yield coming.pop(0).result()
        finally:
            pool.shutdown(wait=True, cancel_futures=True)


def split_off(examples: Examples, share: float, seed: int) -> tuple[Examples, Examples | None]:
    """The set without about this share of its groups, and these; nothing is split off a set of fewer than three groups.

    Whole groups, because pictures of one trajectory are near-copies: some of them would tell nothing about others.
    """
    if share <= 0 or examples.group is None:
        return examples, None
    groups = np.unique(examples.group)
    if len(groups) < 3:
        return examples, None
    count = max(round(share * len(groups)), 1)
    kept = np.random.default_rng([seed, _ORDER]).permutation(groups)[:count]
    apart = np.isin(examples.group, kept)
    return examples[~apart], examples[apart]


def stream_description(stream: Stream) -> dict[str, object]:
    """What tells one stream from another: its settings, as far as it has them."""
    names = ("appearance", "seed", "scopes", "intrinsics")
    settings = {name: getattr(stream, name) for name in names if hasattr(stream, name)}
    if getattr(stream, "steered_share", 0.0):
        settings["steered_share"] = stream.steered_share  # type: ignore[attr-defined]
    parts = getattr(stream, "parts", None)
    if parts is not None:
        several = [
            {"anatomy": part.anatomy.digest, "regions": digest(part.regions), **stream_description(part)}
            for part in parts
        ]
        return {"kind": type(stream).__name__, "parts": several}
    views = getattr(getattr(stream, "bank", None), "distribution", None)
    avoid: Pose | None = getattr(stream, "avoid", None)
    passages = [[passage.name, passage.points_mm] for passage in stream.anatomy.passages]
    away = None if avoid is None else avoid.matrix
    return {"kind": type(stream).__name__, "views": views, "passages": passages, "avoid": away, **settings}


def _unseeded(description: object) -> object:
    """What a stream is, but for the seed of its views: the same for runs that differ by nothing else."""
    if isinstance(description, dict):
        return {key: _unseeded(value) for key, value in description.items() if key != "seed"}
    return [_unseeded(one) for one in description] if isinstance(description, list) else description


@dataclass(frozen=True, eq=False)
class _Shown:
    """Square pictures as they are kept, their truth, the vertical angle of each and the camera that they are of.

    None may be turned to be near one of `avoid`.
    """

    images: UInt8[np.ndarray, "b s s 3"]
    region: Int[np.ndarray, "b"]
    pose: Float[np.ndarray, "b 4 4"]
    fov_deg: Float[np.ndarray, "b"]
    intrinsics: Intrinsics
    avoid: Pose | None = None


def _changed(shown: _Shown, config: TrainConfig, step: int) -> Lesson:
    """A lesson from pictures as they are kept: augmented, resized, with strangers behind."""
    size = input_px(config.network)
    images, pose = shown.images, shown.pose
    if config.augmentation is not None:
        rng = np.random.default_rng([config.seed, _CHANGE, step])
        aspect = shown.intrinsics.fx / shown.intrinsics.fy
        images, turn = augment(images, shown.fov_deg, size, config.augmentation, rng, aspect)
        pose = _turned(pose, turn)
        near = _too_near(shown, pose)
        if near.any():
            unturned = replace(config.augmentation, turn_deg=0.0, roll_deg=0.0)
            images[near], turn[near] = augment(shown.images[near], shown.fov_deg[near], size, unturned, rng, aspect)
            pose = _turned(shown.pose, turn)
    else:
        images = fitted(images, size)
    count = round(config.strangers * len(images))
    if count:
        rng = np.random.default_rng([config.seed, _STRANGE, step])
        images = np.concatenate([images, strangers(count, size, images, rng)])
    return Lesson(images, shown.region, pose)


def _turned(pose: Float[np.ndarray, "b 4 4"], turn: Float[np.ndarray, "b 3 3"]) -> Float[np.ndarray, "b 4 4"]:
    pose = pose.copy()
    pose[:, :3, :3] = pose[:, :3, :3] @ turn
    return pose


def _too_near(shown: _Shown, pose: Float[np.ndarray, "b 4 4"]) -> Bool[np.ndarray, "b"]:
    """Which cameras were turned towards a view that is to stay unseen."""
    if shown.avoid is None:
        return np.zeros(len(pose), dtype=bool)
    return neighbours(shown.avoid, Pose(pose, shown.avoid.target, shown.avoid.source))
