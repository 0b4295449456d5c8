"""What `naris simulate` is asked for, in the nouns of the library: which views, under which appearance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from naris.anatomy.distance import SignedDistance, signed_distance
from naris.cli.anatomies import open_anatomy
from naris.cli.looks import look
from naris.cli.simulate import Options
from naris.core.anatomy import Anatomy, RegionSet
from naris.core.camera import Intrinsics
from naris.dataset.generate import Simulation
from naris.errors import InputError, KeyframeError, RegionError
from naris.render.keyframes import Keyframes, interpolate, read_keyframes, read_original_keyframes
from naris.render.scene import Scene
from naris.render.trajectories import Steering, jitter_views, roomy_parts, trajectory_along
from naris.render.viewpoints import (
    VIEW_DISTRIBUTIONS,
    Viewpoints,
    check_in_lumen,
    draw_views,
    joined,
    passages_of,
    view_bank,
)


def simulation(options: Options) -> tuple[Simulation, Scene]:
    """What to simulate, and the scene to do it in.

    Raises:
        InputError: if something in the options cannot be had together or in this anatomy.
    """
    if options.count < 1:
        raise InputError("one picture or more", f"{options.count}", "give --count a number such as 1000")
    appearance = look(options.appearance, options.texture)
    anatomy, regions = open_anatomy(options.anatomy, options.regions)
    scene = Scene(anatomy)
    rng = np.random.default_rng(options.seed)
    return Simulation(
        anatomy=anatomy,
        regions=regions,
        views=_views(options, regions, scene, rng),
        intrinsics=Intrinsics.from_vertical_fov(options.width, options.height, options.fov_deg),
        appearance=appearance,
        seed=options.seed,
        depth=options.depth,
        views_from=_told(options),
    ), scene


def _told(options: Options) -> dict[str, object]:
    """How the views were chosen, for the record; names of files and folders stay out."""
    if options.keyframes is not None:
        return {"kind": "keyframes", "step_mm": options.step_mm, "per_position": options.per_position}
    if options.views == "trajectories":
        return {"kind": "trajectories", "step_mm": options.step_mm, "per_position": options.per_position}
    return {"kind": "distribution", "distribution": VIEW_DISTRIBUTIONS[options.views]}


def _views(options: Options, regions: RegionSet, scene: Scene, rng: np.random.Generator) -> Viewpoints:
    anatomy, distance = scene.anatomy, signed_distance(scene.anatomy)
    if options.keyframes is not None:
        track = interpolate(_keyframes(options, anatomy), options.step_mm)
        views = jitter_views(track, regions, rng, options.per_position)
        check_in_lumen(distance, views.anatomy_T_camera)
        return views
    if options.views == "trajectories":
        return _along_passages(options, anatomy, regions, distance, rng)
    bank = view_bank(distance, passages_of(anatomy, distance), regions, VIEW_DISTRIBUTIONS[options.views])
    return draw_views(scene, bank, options.count, rng)


def _keyframes(options: Options, anatomy: Anatomy) -> Keyframes:
    path = options.keyframes
    if path is None or not path.exists():
        raise KeyframeError("a keyframe file or folder", f"none at {path}", "check the path")
    if path.is_dir() or path.suffix == ".txt":
        return read_original_keyframes(path, anatomy.frame)
    return read_keyframes(path, anatomy)


def _along_passages(
    options: Options, anatomy: Anatomy, regions: RegionSet, distance: SignedDistance, rng: np.random.Generator
) -> Viewpoints:
    """One passage after the other, again and again, until there are enough views."""
    clearance_mm = Steering().clearance_mm
    passages = [p for p in passages_of(anatomy, distance) if roomy_parts(p, clearance_mm)]
    if not passages:
        raise RegionError(f"a passage with {clearance_mm} mm of room", "none", "use --views anywhere")
    parts: list[Viewpoints] = []
    positions = 0
    while positions * options.per_position < options.count:
        passage = passages[len(parts) % len(passages)]
        track = interpolate(trajectory_along(passage, distance, rng), options.step_mm)
        views = jitter_views(track, regions, rng, options.per_position)
        parts.append(replace(views, trajectory=views.trajectory + len(parts), position=views.position + positions))
        positions += len(track)
    return joined(parts)[: options.count]
