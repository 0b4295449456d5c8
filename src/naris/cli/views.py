"""What `naris simulate` is asked for, in the nouns of the library: which views, under which appearance."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Int

from naris.anatomy.distance import SignedDistance, signed_distance
from naris.cli.anatomies import open_anatomy
from naris.cli.cameras import read_intrinsics
from naris.cli.looks import look
from naris.cli.options import check_edges, refuse
from naris.cli.simulate import Options
from naris.core.anatomy import NOWHERE, Anatomy, Passage, RegionSet
from naris.core.camera import Intrinsics
from naris.dataset.generate import Simulation
from naris.errors import KeyframeError, RegionError
from naris.render.keyframes import Keyframes, interpolate, read_keyframes, read_original_keyframes
from naris.render.scene import Scene
from naris.render.trajectories import (
    VIEWS_PER_POSITION,
    Jitter,
    OriginalJitter,
    SteadyHand,
    Steering,
    jitter_views,
    roomy_parts,
    trajectory_along,
)
from naris.render.viewpoints import (
    VIEW_DISTRIBUTIONS,
    Viewpoints,
    check_in_lumen,
    draw_views,
    joined,
    passages_of,
    view_bank,
)

_COUNT, _STEP_MM = 1000, 1.0
_EDGE_PX, _FOV_DEG = 300, 45.0
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class _Choice:
    """How the views are chosen, with the defaults of what was not given.

    Attributes:
        kind: `keyframes`, `trajectories` or the name of a view distribution.
        count: how many, where the kind does not tell itself.
        step_mm: between positions on a way.
        per_position: views at each of them.
        jitter: how these differ.
    """

    kind: str
    count: int
    step_mm: float
    per_position: int
    jitter: Jitter

    @staticmethod
    def of(options: Options) -> _Choice:
        """Raises InputError if an option was given that has no effect on such views."""
        given = "keyframes" if options.keyframes is not None else options.views
        if given == "keyframes":
            refuse(options, ("count", "views"), "only without --keyframes", f"--keyframes {options.keyframes}")
        elif given != "trajectories":
            got = "neither" if given is None else f"--views {given}"
            refuse(options, ("step_mm", "per_position", "jitter"), "only with --views trajectories or --keyframes", got)
        return _Choice(
            given or "inspection",
            _COUNT if options.count is None else options.count,
            _STEP_MM if options.step_mm is None else options.step_mm,
            VIEWS_PER_POSITION if options.per_position is None else options.per_position,
            SteadyHand() if options.jitter == "steady" else OriginalJitter(),
        )

    def told(self) -> dict[str, object]:
        """For the record; names of files and folders stay out."""
        if self.kind in ("keyframes", "trajectories"):
            told: dict[str, object] = {"kind": self.kind, "step_mm": self.step_mm, "per_position": self.per_position}
            return told if self.jitter == OriginalJitter() else {**told, "jitter": "steady"}
        return {"kind": "distribution", "distribution": VIEW_DISTRIBUTIONS[self.kind]}


def simulation(options: Options) -> tuple[Simulation, Scene]:
    """What to simulate, and the scene to do it in.

    Raises:
        InputError: if something in the options cannot be had together or in this anatomy.
    """
    choice = _Choice.of(options)
    camera = _camera(options)
    appearance = look(options.appearance, options.texture)
    anatomy, regions = open_anatomy(options.anatomy, options.regions)
    scene = Scene(anatomy)
    rng = np.random.default_rng(options.seed)
    return Simulation(
        anatomy=anatomy,
        regions=regions,
        views=_views(choice, options.keyframes, regions, scene, rng),
        intrinsics=camera,
        appearance=appearance,
        seed=options.seed,
        depth=options.depth,
        views_from=choice.told(),
    ), scene


def _camera(options: Options) -> Intrinsics:
    if options.intrinsics is not None:
        refuse(options, ("width", "height", "fov_deg"), "only without --intrinsics", f"{options.intrinsics}")
        camera = read_intrinsics(options.intrinsics)
        check_edges(camera.width, camera.height)
        return camera
    width, height = (_EDGE_PX if edge is None else edge for edge in (options.width, options.height))
    return Intrinsics.from_vertical_fov(width, height, _FOV_DEG if options.fov_deg is None else options.fov_deg)


def _views(
    choice: _Choice, keyframes: Path | None, regions: RegionSet, scene: Scene, rng: np.random.Generator
) -> Viewpoints:
    anatomy, distance = scene.anatomy, signed_distance(scene.anatomy)
    if keyframes is not None:
        track = interpolate(_keyframes(keyframes, anatomy), choice.step_mm)
        views = jitter_views(track, regions, rng, choice.per_position, choice.jitter)
        check_in_lumen(distance, views.anatomy_T_camera)
        return views
    if choice.kind == "trajectories":
        return _along_passages(choice, anatomy, regions, distance, rng)
    bank = view_bank(distance, passages_of(anatomy, distance), regions, VIEW_DISTRIBUTIONS[choice.kind])
    return draw_views(scene, bank, choice.count, rng)


def _keyframes(path: Path, anatomy: Anatomy) -> Keyframes:
    if not path.exists():
        raise KeyframeError("a keyframe file or folder", f"none at {path}", "check the path")
    if path.is_dir() or path.suffix == ".txt":
        return read_original_keyframes(path, anatomy.frame)
    return read_keyframes(path, anatomy)


def _along_passages(
    choice: _Choice, anatomy: Anatomy, regions: RegionSet, distance: SignedDistance, rng: np.random.Generator
) -> Viewpoints:
    """One passage after the other, again and again, until there are enough views.

    Each is walked once even where that is more than enough: of one passage a few views would be of one region only.
    """
    clearance_mm = Steering().clearance_mm
    passages = [p for p in passages_of(anatomy, distance) if roomy_parts(p, clearance_mm)]
    passages = [p for p in passages if _can_be_steered(p, distance)]
    if not passages:
        raise RegionError(f"a passage with {clearance_mm} mm of room", "none", "use --views anywhere")
    parts: list[Viewpoints] = []
    positions, wanted = 0, math.ceil(choice.count / choice.per_position)
    while len(parts) < len(passages) or positions < wanted:
        passage = passages[len(parts) % len(passages)]
        track = interpolate(trajectory_along(passage, distance, rng), choice.step_mm)
        views = jitter_views(track, regions, rng, choice.per_position, choice.jitter)
        parts.append(replace(views, trajectory=views.trajectory + len(parts), position=views.position + positions))
        positions += len(track)
    walked = joined(parts)
    return (spread(walked, wanted) if len(parts) == len(passages) else walked)[: choice.count]


def _can_be_steered(passage: Passage, distance: SignedDistance) -> bool:
    """Whether some way along it is free; one that is not is left out, with a notice."""
    try:
        trajectory_along(passage, distance, np.random.default_rng(0))
    except RegionError as error:
        _log.info("%s is left out: %s", passage.name, error)
        return False
    return True


def spread(views: Viewpoints, wanted: int) -> Viewpoints:
    """The views of `wanted` positions: of each region as many as of another, from all that was walked in it alike.

    They stay in the order of walking; trajectories and positions are numbered anew without gaps.
    """
    position, first = np.unique(views.position, return_index=True)
    region = views.region[first]
    names, there = np.unique(region[region != NOWHERE], return_counts=True)
    if there.sum() < wanted:
        return views
    kept = []
    for rank, (name, share) in enumerate(zip(names, _shares(there, wanted), strict=True)):
        walked = position[region == name]
        # With another phase in each region, else all of them would take theirs from the same passage.
        phase = (rank + 0.5) / len(names)
        kept.append(walked[((np.arange(share) + phase) * len(walked) / share).astype(np.int64)])
    chosen = views[np.isin(views.position, np.concatenate(kept))]
    _, trajectory = np.unique(chosen.trajectory, return_inverse=True)
    _, position = np.unique(chosen.position, return_inverse=True)
    return replace(chosen, trajectory=trajectory, position=position)


def _shares(there: Int[np.ndarray, "k"], wanted: int) -> Int[np.ndarray, "k"]:
    """How many to take of each, as equal as there are; `there` together are enough."""
    shares = np.zeros_like(there)
    while (left := wanted - int(shares.sum())) > 0:
        more = np.flatnonzero(shares < there)
        ends = np.floor(np.arange(len(more) + 1) * left / len(more) + 0.5).astype(np.int64)
        shares[more] = np.minimum(shares[more] + np.diff(ends), there[more])
    return shares
