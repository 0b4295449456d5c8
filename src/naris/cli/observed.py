"""What a command line says was seen: a depth image, several with poses, a cloud, a reconstruction, or a picture."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from naris.cli.options import refuse
from naris.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from naris.cli.register import Options
    from naris.core.camera import Intrinsics
    from naris.core.results import DepthEstimate
    from naris.register.noise import DepthNoise, Scale
    from naris.register.observation import Observation

_log = logging.getLogger(__name__)
_ONE_OF = "one of --depth, --rig and --cloud, or a --frame with its --intrinsics"


@dataclass(frozen=True, eq=False)
class Seen:
    """An observation, and what is known of the (first) camera.

    Attributes:
        observation: for the registration.
        intrinsics: of the camera; None of a cloud by itself.
        depth: its depth image; None of clouds, reconstructions and pictures.
        estimate: what a network says of a picture alone, else None.
    """

    observation: Observation
    intrinsics: Intrinsics | None = None
    depth: np.ndarray | None = None
    estimate: DepthEstimate | None = None


def check_observation(options: Options) -> None:
    """See that the options of what was seen go together.

    Raises:
        InputError: if not; the message names them.
    """
    given = [name for name in ("depth", "rig", "cloud") if getattr(options, name) is not None]
    if not given and options.frame is not None:
        _check_frame_alone(options)
        return
    if len(given) != 1:
        got = "none" if not given else f"--{' and --'.join(given)}"
        raise InputError(_ONE_OF, got, "give what the camera saw" if not given else "give one of them")
    of_folder = options.cloud is not None and options.cloud.is_dir()
    if options.cloud is not None and not of_folder:
        if options.model is None and options.intrinsics is None:
            refuse(options, ("frame",), "only with --intrinsics or --model beside --cloud FILE", "neither")
        if options.frame is None:
            refuse(options, ("intrinsics",), "only with the --frame of that camera beside --cloud FILE", "no frame")
    elif options.depth is None:
        refuse(options, ("intrinsics",), "only with --depth, or with --cloud FILE and a --frame", f"--{given[0]}")
    elif options.intrinsics is None:
        raise InputError("--intrinsics with --depth", "none", "give the camera of the depth image")
    if options.depth is None:
        refuse(options, ("depth_sd",), "only with --depth", f"--{given[0]}")
    elif options.depth_sd is not None:
        refuse(options, ("noise",), "only without --depth-sd", "both")
    _check_scale(options, of_folder=of_folder)


def _check_scale(options: Options, *, of_folder: bool) -> None:
    if options.cloud is not None:
        refuse(options, ("depth_unit_mm", "smooth_error"), "only with --depth or --rig", "--cloud")
    if not of_folder:
        refuse(options, ("view",), "only with --cloud FOLDER", "no reconstruction")
        if options.alone:
            raise InputError("--alone only with --cloud FOLDER", "no reconstruction", "leave it out")
    elif options.scale is None:
        raise InputError(
            "--scale with a reconstruction", "none", "say unknown, prior, or known if somebody has made mm of its unit"
        )
    if options.scale != "prior":
        refuse(
            options, ("scale_factor", "scale_spread"), "only with --scale prior", f"--scale {options.scale or 'known'}"
        )
    elif options.scale_factor is None:
        raise InputError("--scale-factor with --scale prior", "none", "give the most likely factor to mm")


def _check_frame_alone(options: Options) -> None:
    if options.intrinsics is None:
        raise InputError(
            "--intrinsics with a --frame alone", "none", "give its camera: the same picture of another lens is nearer"
        )
    what = "only with --depth, --rig or --cloud"
    names = (
        "view",
        "depth_unit_mm",
        "smooth_error",
        "noise",
        "scale",
        "scale_factor",
        "scale_spread",
        "normals_deg",
        "depth_sd",
    )
    refuse(options, names, what, "a --frame alone, whose depth and errors a network tells")
    if options.alone:
        raise InputError("--alone only with --cloud FOLDER", "no reconstruction", "leave it out")
    if options.shape_model is not None or options.modes is not None:
        raise InputError(
            "one of --depth, --rig and --cloud with a shape", "a --frame alone", "give what the camera saw"
        )
    for name, given in (("--contours", options.contours), ("--shading", options.shading)):
        if given:
            why = "leave it out: shading is used"
            raise InputError(f"{name} beside --depth, --rig or --cloud", "a --frame alone", why)
    if options.method != "naris":
        raise InputError("--method naris with a --frame alone", f"--method {options.method}", "leave --method out")


def observe(options: Options) -> Seen:
    """Reads what was seen.

    Raises:
        InputError: if a file cannot be read, or what it holds tells no pose.
    """
    if options.cloud is not None:
        return (_reconstruction if options.cloud.is_dir() else _cloud)(options, options.cloud)
    unit_mm = 1.0 if options.depth_unit_mm is None else options.depth_unit_mm
    if options.rig is not None:
        from naris.cli.cameras import warn_of_centre
        from naris.register.rig import read_rig

        rig = read_rig(options.rig, unit_mm)
        warn_of_centre(rig.intrinsics[0], options.rig)
        if all(sd is not None for sd in rig.sds):
            refuse(options, ("noise",), "only without depth_sd of all views", f"{options.rig.name}, which names them")
        scale = _scale(options, rig.depths[0])
        return Seen(rig.observed(_noise(options, scale), scale), rig.intrinsics[0], rig.depths[0])
    from naris.cli.cameras import read_intrinsics
    from naris.register.files import DEVIATIONS, read_depth_image
    from naris.register.observation import from_depth

    if options.intrinsics is None:
        raise InputError(_ONE_OF, "none", "give what the camera saw")
    intrinsics = read_intrinsics(options.intrinsics)
    if options.depth is None:
        return _picture(options, intrinsics)
    depth = read_depth_image(options.depth, unit_mm)
    sd = None if options.depth_sd is None else read_depth_image(options.depth_sd, unit_mm, DEVIATIONS)
    scale = _scale(options, depth)
    return Seen(from_depth(depth, intrinsics, _noise(options, scale), scale, sd), intrinsics, depth)


def _picture(options: Options, intrinsics: Intrinsics) -> Seen:
    from naris.core.pictures import read_picture
    from naris.locate.depth import open_depth
    from naris.register.observation import from_estimate

    if options.frame is None:
        raise InputError(_ONE_OF, "none", "give what the camera saw")
    picture = read_picture(options.frame)
    _check_size(picture, intrinsics)
    estimate = open_depth().estimate(picture, intrinsics)
    return Seen(from_estimate(estimate), intrinsics, estimate=estimate)


def _cloud(options: Options, file: Path) -> Seen:
    import numpy as np

    from naris.cli.cameras import read_intrinsics
    from naris.register.files import has_normals, read_cloud, read_normals
    from naris.register.noise import PointNoise
    from naris.register.observation import from_points

    points = read_cloud(file)
    scale = _scale(options, np.linalg.norm(points, axis=1))
    noise = PointNoise()
    noise = replace(noise, sd_mm=noise.sd_mm / scale.middle if options.noise is None else options.noise)
    if options.normals_deg is not None:
        noise = replace(noise, normals_deg=options.normals_deg)
    normals = read_normals(file) if options.method == "imlop" else None
    if normals is None and has_normals(file):
        _log.warning("%s has normals, which are not used: --method imlop uses them", file.name)
    intrinsics = None if options.intrinsics is None else read_intrinsics(options.intrinsics)
    return Seen(from_points(points, noise, scale, normals), intrinsics)


def _reconstruction(options: Options, folder: Path) -> Seen:
    import numpy as np

    from naris.cli.cameras import warn_of_centre
    from naris.register.noise import PointNoise
    from naris.register.sfm.read import read_reconstruction
    from naris.register.sfm.reconstruction import noise_of, observed

    made = read_reconstruction(folder)
    view = made.view(options.view)
    points = made.seen_by(view)
    noise = noise_of(points) if options.noise is None else PointNoise(options.noise)
    scale = _scale(options, np.linalg.norm(points, axis=1))
    warn_of_centre(view.intrinsics, folder)
    return Seen(observed(made, view, noise, scale, alone=options.alone), view.intrinsics)


def _noise(options: Options, scale: Scale) -> DepthNoise:
    """As it is said; else what is usual, in the unit of the depth as the scale has it."""
    from naris.register.noise import DepthNoise

    plain = DepthNoise()
    return DepthNoise(
        plain.smooth if options.smooth_error is None else options.smooth_error,
        plain.reach_deg,
        plain.pixel_mm / scale.middle if options.noise is None else options.noise,
    )


def _scale(options: Options, distances: np.ndarray) -> Scale:
    """As it is said; an unknown one makes endoscopic distances of these, which are above 0 where they are known."""
    import numpy as np

    from naris.register.noise import Scale, any_scale

    if options.scale == "prior" and options.scale_factor is not None:
        spread = 0.2 if options.scale_spread is None else options.scale_spread
        return Scale("prior", options.scale_factor, math.log1p(spread))
    if options.scale == "unknown":
        known = distances[np.isfinite(distances) & (distances > 0)]
        return any_scale(float(np.median(known)) if len(known) else 0.0)
    return Scale(options.scale or "known")


def ground_of(options: Options, seen: Seen) -> np.ndarray | None:
    """What the walls are drawn on: the frame, or else the depth image; None where there is neither.

    Raises:
        ImageError: if the frame is not of the size that the intrinsics say.
    """
    from naris.core.pictures import read_picture
    from naris.register.look import shaded

    camera = seen.intrinsics
    if camera is None or options.frame is None:
        return None if seen.depth is None else shaded(seen.depth)
    picture = read_picture(options.frame)
    _check_size(picture, camera)
    return picture


def _check_size(picture: np.ndarray, camera: Intrinsics) -> None:
    from naris.errors import ImageError

    if picture.shape[:2] != (camera.height, camera.width):
        raise ImageError(
            f"a picture of {camera.width}×{camera.height} pixels, as the intrinsics say",
            f"{picture.shape[1]}×{picture.shape[0]}",
            "give the frame that was registered, or the intrinsics of this one",
        )
