"""Simulate endoscopy: pictures of an anatomy with poses, regions and depth; a stopped run goes on where it was."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from naris.cli.console import Console
from naris.cli.options import IfGiven

if TYPE_CHECKING:
    from naris.dataset.read import Dataset


@dataclass(frozen=True)
class Options:
    """What to simulate, and where to."""

    anatomy: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="ANATOMY")]
    """`builtin`, a surface file in mm (PLY, STL, OBJ, VTP), or a folder made by naris anatomy."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="DIR")]
    """Folder of the data set: new, or one that this very command began."""
    count: IfGiven[int] = None
    """How many pictures; 1000 when not given. Not with --keyframes, which tell themselves."""
    views: IfGiven[Literal["inspection", "travel", "anywhere", "trajectories"]] = None
    """inspection, when not given: along the passages, some depth ahead, each region equally often; travel: the same,
    and each stretch of the way equally often; anywhere: any place with room; trajectories: steered along every passage,
    several views at each position, and where --count asks for fewer positions than that gives, those that are spread
    evenly over regions and passages. Not with --keyframes."""
    keyframes: Annotated[IfGiven[Path], tyro.conf.arg(metavar="FILE|DIR")] = None
    """Go from keyframe to keyframe instead: a JSON file (docs/keyframes.md) or the original's folder of text files."""
    step_mm: IfGiven[float] = None
    """Between positions on a trajectory or from keyframe to keyframe, in mm; 1 when not given. Only with --views
    trajectories or --keyframes."""
    per_position: IfGiven[int] = None
    """Views at each of these positions; 10 when not given. Only with --views trajectories or --keyframes."""
    jitter: IfGiven[Literal["original", "steady"]] = None
    """How these views differ: original, when not given: the direction as in the published code, about 0.6° each way;
    steady: a hand that tilts and rolls by 3°. Only with --views trajectories or --keyframes."""
    regions: Annotated[IfGiven[str], tyro.conf.arg(metavar="NAME|FILE|slabs")] = None
    """Region set that labels the views: one of the anatomy's own, a JSON file, or four even slabs; by default its
    first."""
    appearance: Literal["endoscope", "training", "unseen", "paper", "paper-culled"] = "endoscope"
    """endoscope: one realistic look; training, unseen: a look for each picture, from disjoint distributions;
    paper: the published light; paper-culled: the same with near walls culled, as the published code did."""
    texture: Annotated[IfGiven[Path], tyro.conf.arg(metavar="FILE")] = None
    """A picture that colours the walls vertex by vertex, as in the published experiment."""
    width: IfGiven[int] = None
    """Of the pictures, in pixels; 300 when not given. Not with --intrinsics."""
    height: IfGiven[int] = None
    """Of the pictures, in pixels; 300 when not given. Not with --intrinsics."""
    fov_deg: IfGiven[float] = None
    """Vertical field of view, in degrees, of a camera without distortion; 45 when not given. Not with --intrinsics."""
    intrinsics: Annotated[IfGiven[Path], tyro.conf.arg(metavar="FILE")] = None
    """Look through this camera instead, lens and all (pinhole, Brown, fisheye): JSON with width, height, fx, fy, cx, cy
    in pixels and the lens, as in the dataset.json of a data set."""
    seed: int = 0
    """Of everything random: the same seed gives the same bytes, for any number of workers."""
    depth: bool = True
    """Keep depth, as 16-bit PNG."""
    original: Annotated[IfGiven[Path], tyro.conf.arg(metavar="DIR")] = None
    """Write the pictures and poses also as the frame/ and pose/ folders of the published code: in a folder without
    them, or with those that this very command wrote."""
    workers: Annotated[IfGiven[int], tyro.conf.arg(metavar="N")] = None
    """Threads; by default one a core."""


def run(options: Options, console: Console) -> int:
    """Makes the data set, or what is still missing of it."""
    from naris.cli import views
    from naris.dataset.generate import simulate
    from naris.dataset.layout import image_name
    from naris.dataset.original import check_original, write_original

    began_s = time.perf_counter()
    simulation, scene = views.simulation(options)
    if options.original is not None:  # a folder that will be refused should not cost the whole simulation first
        pictures = [options.out / image_name(i) for i in range(len(simulation.views))]
        check_original(options.original, simulation.views.anatomy_T_camera, pictures)
    dataset = simulate(simulation, options.out, scene=scene, workers=options.workers, progress=console.progress)
    if options.original is not None:
        write_original(dataset, options.original)
    _answer(console, dataset, time.perf_counter() - began_s)
    return 0


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    return f"the pictures that are whole stay in {options.out}; the same command goes on from there"


def _answer(console: Console, dataset: Dataset, seconds: float) -> None:
    names, labels = dataset.regions.names, dataset.labels.tolist()
    counts = {name: labels.count(index) for index, name in enumerate(names)}
    data = {
        "folder": dataset.folder,
        "count": len(dataset),
        "anatomy": {"name": dataset.anatomy_name, "digest": dataset.anatomy_digest},
        "region_set": dataset.regions.name,
        "regions": counts,
        "engine": dataset.about.get("engine"),
        "seconds": round(seconds, 2),
    }
    width = max(map(len, names))
    lines = [f"{len(dataset)} pictures of {dataset.anatomy_name} in {dataset.folder} ({seconds:.1f} s)"]
    lines += [f"  {name:<{width}}  {count}" for name, count in counts.items()]
    console.answer(data, "\n".join(lines))
