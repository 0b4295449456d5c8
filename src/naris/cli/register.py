"""Find the pose of the camera in an anatomy from depth, points or a picture alone, or say that it cannot be told."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from naris.cli.console import Console
from naris.cli.observed import check_observation, ground_of, observe
from naris.cli.options import IfGiven, refuse
from naris.cli.registered import check_folder, look_of_refused, looks_of, made_from, write_registered
from naris.cli.registration import doubts, text, told
from naris.errors import InputError, RegionError

if TYPE_CHECKING:
    import numpy as np

    from naris.cli.observed import Seen
    from naris.core.anatomy import Anatomy, RegionSet
    from naris.core.results import Registration
    from naris.register.map import RegistrationMap
    from naris.register.starts import Belief

REFUSED = 1


@dataclass(frozen=True)
class Options:
    """What was seen, where, and what is known of it."""

    anatomy: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="ANATOMY")]
    """The folder of an anatomy, a surface file, or the word builtin."""
    depth: Annotated[IfGiven[Path], tyro.conf.arg(metavar="FILE")] = None
    """Z-depth of one frame: a 16-bit PNG or TIFF, or a .npy (H, W); 0 or NaN where it is not known."""
    depth_sd: Annotated[IfGiven[Path], tyro.conf.arg(metavar="FILE")] = None
    """Standard deviation of each pixel's depth by itself, as the depth is given: in the place of --noise, and of the
    same size. A pixel without one is not used. With --depth; of a rig its JSON names them."""
    rig: Annotated[IfGiven[Path], tyro.conf.arg(metavar="FILE")] = None
    """JSON that lists depth images of several frames, their cameras, and first_T_camera of each."""
    cloud: Annotated[IfGiven[Path], tyro.conf.arg(metavar="PATH")] = None
    """Points that the camera sees, in its frame (x right, y down, z forward): .ply, .npy, or three numbers a line.
    Or the folder of a reconstruction: a sparse model of COLMAP (text or binary), or motion.yaml and structure.ply."""
    view: Annotated[IfGiven[str], tyro.conf.arg(metavar="NAME")] = None
    """The picture of the reconstruction whose camera is sought. With --cloud FOLDER."""
    alone: bool = False
    """Take the points that this picture saw and no others. With --cloud FOLDER."""
    intrinsics: Annotated[IfGiven[Path], tyro.conf.arg(metavar="FILE")] = None
    """Camera of the depth image: JSON with width, height, fx, fy, cx, cy in pixels and the lens. With --depth; or that
    of the frame: where it is all there is, or with --cloud FILE and --contours or --shading."""
    depth_unit_mm: IfGiven[float] = None
    """What one step of the depth image is, in mm; 1 when not given. With --depth or --rig."""
    scale: IfGiven[Literal["known", "unknown", "prior"]] = None
    """Whether depths and points are in mm; if not, a factor is estimated: of an unknown scale any that puts the median
    3 to 30 mm away. Known when not given; of a reconstruction it must be given."""
    scale_factor: IfGiven[float] = None
    """The most likely factor to mm. With --scale prior."""
    scale_spread: IfGiven[float] = None
    """How far the factor may be off, as a share (one standard deviation). With --scale prior; 0.2 when not given."""
    smooth_error: IfGiven[float] = None
    """Relative error of the depth that varies slowly over the picture (one standard deviation); 0.05 when not given.
    With --depth or --rig."""
    noise: IfGiven[float] = None
    """Error of each pixel or point by itself (one standard deviation), in mm, or in their own unit where the scale is
    not known; when not given 0.3 mm for a depth image, 0.5 mm for a cloud, as the likeliest scale has it, and 3 % of
    the median distance for a reconstruction."""
    method: Literal["naris", "icp", "imlp", "imlop", "small_gicp", "small_gicp_planes", "open3d"] = "naris"
    """What the best starts are solved by: naris by rays and the smooth error; icp, imlp and imlop match points with the
    walls, imlop their normals too (six numbers a line, a .npy (N, 6), or a PLY with nx, ny and nz). So do the libraries
    small_gicp (as GICP, or points to planes) and open3d, where they are installed. All those need --scale known."""
    normals_deg: IfGiven[float] = None
    """Error of the normals, in degrees (one standard deviation); 15 when not given. With --method imlop."""
    region: Annotated[IfGiven[str], tyro.conf.arg(metavar="NAME")] = None
    """The region that the camera is in, if somebody knows."""
    regions: Annotated[IfGiven[str], tyro.conf.arg(metavar="SET")] = None
    """The region set that --region is of; by default the anatomy's first."""
    frame: Annotated[IfGiven[Path], tyro.conf.arg(metavar="PICTURE")] = None
    """The picture, of several the first: for a model to say where it was taken, and to draw the walls on. Without
    depth or points a network that ships with naris says how far away its walls are; many such poses are refused."""
    model: Annotated[IfGiven[Path], tyro.conf.arg(aliases=["-m"], metavar="MODEL")] = None
    """Weights made by naris train on this anatomy; they say where to begin. With --frame."""
    contours: bool = False
    """Then move the pose until edges of walls fall on edges of the frame. With --frame and its camera."""
    shading: bool = False
    """Then move the pose until our picture from there is shaded as the frame. With --frame and its camera."""
    most_tilt_deg: float = 90.0
    """The camera looks within this angle of the way inwards, where no pose is known."""
    most_roll_deg: float = 40.0
    """The camera is rolled by at most so much from upright, where no pose is known; 180 for any."""
    probability: IfGiven[float] = None
    """A pose that is less likely than this to be within 2 mm and 5° is refused; 0.8 when not given. Not with
    --shape-model or --modes."""
    shape_model: Annotated[IfGiven[Path], tyro.conf.arg(metavar="DIR")] = None
    """A shape model made by naris anatomy shape-model, whose mean (DIR/mean) ANATOMY is: the shape is estimated, too.
    For a patient without CT."""
    modes: IfGiven[int] = None
    """How many modes the shape has at most: of the shape model (all when not given), or without one of a Gaussian
    process around ANATOMY, as naris anatomy sample draws from; 60 are usual."""
    seed: int = 0
    """Of the starts beside poses that a model believes in, and beside the best pose found."""
    out: Annotated[IfGiven[Path], tyro.conf.arg(aliases=["-o"], metavar="DIR")] = None
    """Folder for the result, a transform and landmarks for 3D Slicer, and pictures: new, empty, or an earlier one."""


def run(options: Options, console: Console) -> int:
    """Registers and tells the pose; exit status 1 where it is refused."""
    from naris.cli.anatomies import map_of, open_anatomy

    _check(options)
    if options.out is not None:
        check_folder(options.out, options.anatomy)
    seen = observe(options)
    ground = ground_of(options, seen)
    anatomy, regions = open_anatomy(options.anatomy, options.regions)
    made = made_from(options)
    belief, believed = _belief(options, anatomy, regions)
    if options.shape_model is not None or options.modes is not None:
        from naris.cli.deformable import Shaped, register_shape

        return register_shape(options, anatomy, seen, Shaped(belief, believed, ground, regions, made), console)
    with console.progress.task("preparing the anatomy", 1) as advance:
        at = map_of(anatomy)
        advance(1)
    with console.progress.task("registering", 1) as advance:
        found = _registered(options, at, seen, ground, belief)
        advance(1)
    if options.region is not None:
        from naris.register.named import unless_elsewhere

        found = unless_elsewhere(found, regions, options.region)
    found, by_frame = _with_frame(options, found, (at, belief), seen, ground)
    data = told(found, anatomy, seen.observation, options.method) | by_frame | {"model": believed}
    data["made_from"] = made
    if options.out is not None:
        pose = found.anatomy_T_camera
        if pose is None:
            looks = look_of_refused(found.best, anatomy, seen, ground)
        else:
            looks = looks_of(pose, anatomy, seen, ground, flickers=options.frame is not None)
        data["files"] = write_registered(options.out, pose, anatomy, looks, data)
    console.answer(data, text(data, doubts(options, seen)))
    return 0 if found.status == "registered" else REFUSED


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    return "nothing was kept; run the same command again"


def _check(options: Options) -> None:
    check_observation(options)
    if options.method != "naris" and options.scale not in (None, "known"):
        raise InputError(f"--scale known with --method {options.method}", f"{options.scale}", "take --method naris")
    if options.method != "imlop":
        refuse(options, ("normals_deg",), "only with --method imlop", f"--method {options.method}")
    elif options.cloud is None or options.cloud.is_dir():
        raise InputError("--cloud FILE with --method imlop", "another observation", "take --method imlp")
    if options.region is None:
        refuse(options, ("regions",), "only with --region", "no region")
    if (options.model is not None) and options.frame is None:
        raise InputError("--frame with --model", "none", "give the picture that the model is to look at")
    if options.contours and options.shading:
        raise InputError("one of --contours and --shading", "both", "take --shading")
    if options.contours or options.shading:
        _check_camera(options)
    if options.model is not None:
        refuse(options, ("region",), "without --model", "a model that tells the region")
    if options.shape_model is not None or options.modes is not None:
        refuse(options, ("probability",), "only without a shape", "a shape, whose registration has none")
        if options.contours or options.shading:
            name = "--contours" if options.contours else "--shading"
            raise InputError(f"{name} only without a shape", "a shape", "leave it out")
        if options.method != "naris":
            raise InputError("--method naris with a shape", f"--method {options.method}", "leave --method out")


def _check_camera(options: Options) -> None:
    what = "--contours" if options.contours else "--shading"
    of_points = options.cloud is not None and not options.cloud.is_dir()
    for name, lacks in (("frame", options.frame is None), ("intrinsics", of_points and options.intrinsics is None)):
        if lacks:
            raise InputError(f"--{name} with {what}", "none", "give the frame and its camera")


def _belief(options: Options, anatomy: Anatomy, regions: RegionSet) -> tuple[Belief, dict[str, Any] | None]:
    """What is believed, and what a model said of the frame. A frame unlike those that it knows tells it nothing."""
    from naris.register.starts import NOTHING, Orientation, in_region, of_prediction

    orientation = Orientation(options.most_tilt_deg, options.most_roll_deg)
    if options.region is not None:
        of_others = [name for name, one in anatomy.regions.items() if options.region in one.names]
        if options.region not in regions.names and of_others:
            raise RegionError(f"a region of {regions.name}", options.region, f"give --regions {of_others[0]} with it")
        return in_region(regions, options.region, orientation), None
    if options.model is None or options.frame is None:
        return replace(NOTHING, orientation=orientation), None
    from naris.cli.models import open_model
    from naris.dataset.layout import RegionLabels
    from naris.errors import CheckpointError
    from naris.locate import is_strange, locate

    localizer = open_model(options.model)
    subject = localizer.checkpoint.subject
    if subject.anatomy_digest != anatomy.digest:
        raise CheckpointError(
            f"a model made for {anatomy.name}", f"one made for {subject.anatomy}", "train one on this anatomy"
        )
    regions = anatomy.region_set(subject.regions.name)
    if subject.regions.digest not in (None, RegionLabels.of(regions).digest):
        raise CheckpointError(
            f"a model of the regions {regions.name} of {anatomy.name}", "one of others", "train one on this anatomy"
        )
    (prediction,) = locate([options.frame], localizer)
    used = not is_strange(prediction)
    believed = of_prediction(prediction, regions) if used else NOTHING
    said = {
        "region": prediction.region_name,
        "probability": float(prediction.probabilities.max()),
        "out_of_domain": prediction.out_of_domain,
        "used": used,
    }
    return replace(believed, orientation=orientation), said


def _registered(
    options: Options, at: RegistrationMap, seen: Seen, frame: np.ndarray | None, belief: Belief
) -> Registration:
    from naris.register.register import RegisterConfig, register

    changes: dict[str, Any] = {"seed": options.seed}
    if options.probability is not None:
        changes["least_probability"] = options.probability
    if seen.estimate is None or seen.intrinsics is None or frame is None:
        return register(at, seen.observation, belief, RegisterConfig(method=options.method, **changes))
    from naris.register.picture import SEARCH, PictureConfig, register_picture
    from naris.render.scene import Scene

    config = PictureConfig(replace(SEARCH, **changes))
    whole = frame, seen.intrinsics, seen.estimate
    return register_picture(at, Scene(at.anatomy), whole, belief, config)


def _with_frame(
    options: Options,
    found: Registration,
    of: tuple[RegistrationMap, Belief],
    seen: Seen,
    frame: np.ndarray | None,
) -> tuple[Registration, dict[str, Any]]:
    """The pose as edges or shading of the frame have it, and what is told of them; None where that is not asked for."""
    by_frame: dict[str, Any] = {"contours": None, "shading": None}
    if not (options.contours or options.shading) or frame is None or seen.intrinsics is None:
        return found, by_frame
    import math

    from naris.register.astray import unless_astray
    from naris.render.scene import Scene

    scene = Scene(of[0].anatomy)
    if options.contours:
        from naris.register.contour import sharpened

        made = sharpened(scene, found, frame, seen.intrinsics)
        before, after = (None if math.isnan(px) else px for px in made.off_px)
        moved = {"edges": made.edges, "used": made.moved_mm > 0, "moved_mm": made.moved_mm, "moved_deg": made.moved_deg}
        by_frame["contours"] = moved | {"off_px_before": before, "off_px_after": after}
        return (unless_astray(made.registration, *of, "--contours") if moved["used"] else found), by_frame
    from naris.register.shading import reshaded

    shaded = reshaded(scene, found, frame, seen.intrinsics)
    moved = {"used": shaded.used, "moved_mm": shaded.moved_mm, "moved_deg": shaded.moved_deg}
    moved |= {"cost_before": shaded.cost[0], "cost_after": shaded.cost[1]}
    by_frame["shading"] = moved
    return (unless_astray(shaded.registration, *of, "--shading") if shaded.used else found), by_frame
