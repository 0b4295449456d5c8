"""Views drawn and rendered anew for every batch: a data set without end, and without files.

Batch `index` depends on the stream's seed and on `index` alone, so a training that goes on after an interruption sees
the batches that it would have seen. Colour, light, gain and noise come from the appearance distribution. Pictures are
never mirrored: left and right nostrils mirror each other, and a flipped picture would show the other side under the
wrong name.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property
from typing import cast

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from naris.anatomy.distance import signed_distance
from naris.core.anatomy import Anatomy, RegionSet
from naris.core.camera import Intrinsics
from naris.core.pose import Pose
from naris.dataset.pilot import Pilot, everything
from naris.errors import InputError
from naris.render.appearance import Appearance, AppearanceDistribution
from naris.render.near import neighbours
from naris.render.scene import Scene, render
from naris.render.viewpoints import (
    ViewBank,
    ViewDistribution,
    Viewpoints,
    draw_views,
    joined,
    passages_of,
    view_bank,
)

_STEERED = 2**41  # a batch's number that no training comes to


@dataclass(frozen=True)
class Scopes:
    """Which cameras a stream looks through.

    Each batch is cut into groups of `group` views; each group has its own field of view and its own optical axis.

    Attributes:
        vertical_fov_deg: between these two, uniform in the focal length; None keeps that of the stream's intrinsics.
        shift: the principal point is off by up to this share of width and height (a crop that is off centre).
        group: views that share a camera.
    """

    vertical_fov_deg: tuple[float, float] | None = None
    shift: float = 0.0
    group: int = 8

    def __post_init__(self) -> None:
        low, high = self.vertical_fov_deg or (45.0, 45.0)
        if not (0 < low <= high < 180 and 0 <= self.shift < 0.5 and self.group >= 1):
            raise InputError(
                "fields of view of 0–180°, a shift of 0–0.5 and groups of 1 or more", f"{self}", "correct them"
            )

    def draw(self, intrinsics: Intrinsics, rng: np.random.Generator) -> Intrinsics:
        """The camera of one group."""
        if self.vertical_fov_deg is not None:
            ends = [
                Intrinsics.from_vertical_fov(intrinsics.width, intrinsics.height, fov, intrinsics.lens).fy
                for fov in self.vertical_fov_deg
            ]
            focal = float(rng.uniform(min(ends), max(ends)))
            intrinsics = replace(intrinsics, fx=focal * intrinsics.fx / intrinsics.fy, fy=focal)
        off = self.shift * rng.uniform(-1, 1, 2)
        return replace(
            intrinsics,
            cx=intrinsics.cx + float(off[0]) * intrinsics.width,
            cy=intrinsics.cy + float(off[1]) * intrinsics.height,
        )


ONE_SCOPE = Scopes()
"""Every view through the stream's own intrinsics."""

MANY_SCOPES = Scopes(vertical_fov_deg=(38.0, 75.0), shift=0.06)
"""Fields of view of common scopes after cropping, the axis a little off: for a model that shall read other scopes."""


@dataclass(frozen=True, eq=False)
class Batch:
    """B views.

    Attributes:
        images: (B, H, W, 3) uint8, RGB.
        region: (B,) label.
        anatomy_T_camera: (B,) poses.
        vertical_fov_deg: (B,) of each view's camera.
    """

    images: UInt8[np.ndarray, "b h w 3"]
    region: Int[np.ndarray, "b"]
    anatomy_T_camera: Pose
    vertical_fov_deg: Float[np.ndarray, "b"]

    def __len__(self) -> int:
        return len(self.region)


@dataclass(frozen=True, eq=False)
class ViewStream:
    """Batches of views by number; make one with `view_stream`.

    Attributes:
        scene: the anatomy that is seen.
        bank: the places and the distribution that views come from, and the region set that labels them.
        appearance: of every view, or what to draw each view's from.
        intrinsics: of every view, but for `scopes`.
        seed: of everything.
        scopes: which cameras.
        avoid: views that are to stay unseen: none is drawn near one of them (`naris.render.near`).
        threads: for rendering; one a core when None. They change no bit.
        steered_share: of each batch, seen by a camera that is steered through the passages (`naris.dataset.pilot`); the
            rest is drawn from the bank. A user's views are steered, but a network that has seen nothing else is lost
            where a hand slips.
    """

    scene: Scene
    bank: ViewBank
    appearance: Appearance | AppearanceDistribution
    intrinsics: Intrinsics
    seed: int
    scopes: Scopes = ONE_SCOPE
    avoid: Pose | None = None
    threads: int | None = None
    steered_share: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.steered_share <= 1:
            raise InputError("a share of steered views of 0–1", f"{self.steered_share}", "correct it")

    @property
    def regions(self) -> RegionSet:
        return self.bank.regions

    @property
    def anatomy(self) -> Anatomy:
        return self.scene.anatomy

    def with_steered(self, share: float) -> ViewStream:
        """The stream with that share of each batch seen by a steered camera."""
        return replace(self, steered_share=share)

    def away_from(self, unseen: Pose) -> ViewStream:
        """The stream without views near these (M,): what a clean test with them asks for."""
        return replace(self, avoid=unseen)

    def batch(self, index: int, size: int) -> Batch:
        """Batch number `index` of `size` views; the same bits for the same seed, index and size.

        Raises:
            RegionError: if a region has no view that the distribution allows.
        """
        rng = np.random.default_rng([self.seed, index])
        steered = round(self.steered_share * size)
        parts = [draw_views(self.scene, self.bank, size - steered, rng, self.avoid)] if steered < size else []
        if steered:
            parts.append(self._pilot.glimpses(steered, rng, self.avoid))
        return self._seen(parts[0] if len(parts) == 1 else joined(parts), rng)

    def steered(self, positions: int, per_position: int) -> Batch:
        """What a camera sees that is steered through the passages (`naris.dataset.pilot`), always the same views.

        They are as a user's will be, where those of a batch are spread over all that could be seen. About equally many
        are in each region; none is near one of `avoid`.

        Raises:
            RegionError, PoseError: if nobody can steer into one of the regions, or only near the views to avoid.
        """
        rng = np.random.default_rng([self.seed, _STEERED])
        pilot = Pilot.in_(self.scene, self.regions, per_position)
        return self._seen(pilot.collect(positions, self._not_near, rng, longest=1), rng)

    @cached_property
    def _pilot(self) -> Pilot:
        return Pilot.in_(self.scene, self.regions, per_position=1)

    def _not_near(self, views: Viewpoints) -> Bool[np.ndarray, "n"]:
        """Which views are near none of `avoid`."""
        if self.avoid is None:
            return everything(views)
        return np.asarray(~neighbours(self.avoid, views.anatomy_T_camera))

    def _seen(self, views: Viewpoints, rng: np.random.Generator) -> Batch:
        size = len(views)
        looks = [self._look(rng) for _ in range(size)]
        seeds = rng.integers(2**31, size=size)
        images = np.empty((size, self.intrinsics.height, self.intrinsics.width, 3), dtype=np.uint8)
        fov_deg = np.empty(size)
        group = size if self.scopes == ONE_SCOPE else self.scopes.group
        for start in range(0, size, group):
            part = slice(start, min(start + group, size))
            camera = self.scopes.draw(self.intrinsics, rng)
            poses = views.anatomy_T_camera[part]
            rendering = render(
                self.scene, poses, camera, looks[part], want=("rgb",), seeds=seeds[part], threads=self.threads
            )
            images[part] = cast(np.ndarray, rendering.rgb)
            fov_deg[part] = camera.vertical_fov_deg
        return Batch(images, views.region, views.anatomy_T_camera, fov_deg)

    def batches(self, indices: Iterable[int], size: int, ahead: int = 2) -> Iterator[Batch]:
        """The batches of those numbers in order, the next `ahead` of them made on a thread meanwhile."""
        numbers = iter(indices)
        coming: deque[Future[Batch]] = deque()
        with ThreadPoolExecutor(1, thread_name_prefix="views") as pool:
            try:
                while True:
                    while len(coming) < ahead + 1 and (number := next(numbers, None)) is not None:
                        coming.append(pool.submit(self.batch, number, size))
                    if not coming:
                        return
                    yield coming.popleft().result()
            finally:
                pool.shutdown(wait=True, cancel_futures=True)

    def _look(self, rng: np.random.Generator) -> Appearance:
        return self.appearance.sample(rng) if isinstance(self.appearance, AppearanceDistribution) else self.appearance


@dataclass(frozen=True, eq=False)
class SeveralStreams:
    """Streams over several anatomies as one: each batch is of one of them, in turn.

    Attributes:
        parts: the streams, with regions of the same names and the same intrinsics.

    Raises:
        InputError: if there are none, or their region sets or cameras differ.
    """

    parts: tuple[ViewStream, ...]

    def __post_init__(self) -> None:
        kinds = {(part.regions.names, part.anatomy.frame, part.intrinsics) for part in self.parts}
        if len(kinds) != 1:
            raise InputError(
                "streams with the same regions, frame and camera", f"{len(kinds)} kinds", "give those of one kind"
            )

    @property
    def anatomy(self) -> Anatomy:
        """The first one, in whose name the others speak."""
        return self.parts[0].anatomy

    @property
    def regions(self) -> RegionSet:
        return self.parts[0].regions

    @property
    def intrinsics(self) -> Intrinsics:
        return self.parts[0].intrinsics

    @property
    def avoid(self) -> Pose | None:
        """The views that stay unseen, those of all parts together."""
        given = [part.avoid for part in self.parts if part.avoid is not None]
        if not given:
            return None
        return Pose(np.concatenate([one.matrix for one in given]), given[0].target, given[0].source)

    def batch(self, index: int, size: int) -> Batch:
        """Batch number `index` of `size` views, all of anatomy `index` modulo their number.

        Raises:
            RegionError: if a region has no view that the distribution allows.
        """
        return self.parts[index % len(self.parts)].batch(index, size)

    def steered(self, positions: int, per_position: int) -> Batch:
        """As a stream's, in each anatomy its share of the positions.

        Raises:
            RegionError, PoseError: if nobody can steer into one of the regions.
        """
        share = -(-positions // len(self.parts))
        return _joined([part.steered(share, per_position) for part in self.parts])


def _joined(batches: Sequence[Batch]) -> Batch:
    first = batches[0].anatomy_T_camera
    return Batch(
        np.concatenate([batch.images for batch in batches]),
        np.concatenate([batch.region for batch in batches]),
        Pose(np.concatenate([batch.anatomy_T_camera.matrix for batch in batches]), first.target, first.source),
        np.concatenate([batch.vertical_fov_deg for batch in batches]),
    )


def view_stream(
    scene: Scene,
    regions: RegionSet,
    views: ViewDistribution,
    appearance: Appearance | AppearanceDistribution,
    intrinsics: Intrinsics,
    seed: int,
    scopes: Scopes = ONE_SCOPE,
) -> ViewStream:
    """A stream over an anatomy; finds its passages and the places with room first (a few seconds).

    Raises:
        RegionError: if a region has no room for a camera.
    """
    distance = signed_distance(scene.anatomy)
    bank = view_bank(distance, passages_of(scene.anatomy, distance), regions, views)
    return ViewStream(scene, bank, appearance, intrinsics, seed, scopes)
