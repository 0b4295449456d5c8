"""Steer the scope through an anatomy in the browser: what it sees, where it is, keyframes and pictures along them."""

from __future__ import annotations

import threading
import webbrowser
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from naris.cli.console import Console
from naris.cli.options import IfGiven

if TYPE_CHECKING:
    from naris.core.anatomy import Anatomy
    from naris.core.camera import Intrinsics
    from naris.core.progress import Progress
    from naris.serve.messages import SimulationAsked
    from naris.serve.slices import Slices
    from naris.serve.viewer import Locate, Simulate


_WAIT_S = 30.0  # for a simulation to end, so that nothing half made stays


@dataclass(frozen=True)
class Options:
    """What to look at."""

    anatomy: Annotated[tyro.conf.Positional[str], tyro.conf.arg(metavar="ANATOMY")]
    """`builtin`, a surface file in mm (PLY, STL, OBJ, VTP), or a folder made by naris anatomy."""
    regions: Annotated[IfGiven[str], tyro.conf.arg(metavar="NAME|FILE|slabs")] = None
    """Region set to colour with: one of the anatomy's own, a JSON file, or four even slabs; by default its first."""
    model: Annotated[IfGiven[Path], tyro.conf.arg(aliases=["-m"], metavar="MODEL")] = None
    """Weights made by naris train, whose answer to what the scope sees is shown."""
    ct: Annotated[IfGiven[Path], tyro.conf.arg(metavar="SCAN")] = None
    """The CT that the anatomy was found in (DICOM folder or file, NRRD, NIfTI, MetaImage), to show slices of."""
    keyframes: Annotated[Path, tyro.conf.arg(metavar="FILE")] = Path("keyframes.json")
    """The file that keyframes are kept in (docs/keyframes.md); pictures along them go to a folder beside it."""
    port: int = 8765
    """The port of this machine to serve at; where it is in use, the next free one."""
    browser: bool = True
    """Open the page. With --no-browser its address is printed, with how to reach it from another machine."""


def run(options: Options, console: Console) -> int:
    """Serves the page until Ctrl-C."""
    from naris.cli.anatomies import open_anatomy
    from naris.core.atomic import check_writable
    from naris.errors import InputError, RegionError

    if not 0 <= options.port < 65_536:
        raise InputError("a port from 0 to 65535", f"{options.port}", "name another")
    if not options.keyframes.parent.is_dir():
        raise InputError(f"a folder to keep {options.keyframes.name} in", f"no {options.keyframes.parent}", "make it")
    check_writable(options.keyframes)
    try:
        anatomy, regions = open_anatomy(options.anatomy, options.regions)
    except RegionError:
        if options.regions is not None:
            raise
        anatomy, regions = _without_regions(options.anatomy), None
    from naris.serve.app import application
    from naris.serve.run import serve
    from naris.serve.stage import missing, summary
    from naris.serve.viewer import Viewer

    locate, camera, named = (None, None, None) if options.model is None else _model(options.model, anatomy)
    if options.regions is None and named in anatomy.regions:
        regions = anatomy.regions[named]  # those that the model speaks of
    named_set = options.regions or (None if regions is None else regions.name)
    slices = _slices(options, anatomy)
    viewer = Viewer(anatomy, regions, options.keyframes, locate, camera, _simulate(options, named_set), slices)
    viewer.prepare()
    for lacking in missing(anatomy, regions):
        console.log.warning("%s has %s", anatomy.name, lacking)

    def ready(address: str, port: int) -> None:
        if options.port not in (0, port):
            console.log.warning("port %d is in use; this is %d", options.port, port)
        told = {"address": address, "port": port, **summary(anatomy, regions)}
        console.answer(told, _text(address, port, anatomy, is_opened=options.browser))
        if options.browser:
            # From a thread: a browser in a terminal would keep the page from being served.
            threading.Thread(target=_open, args=(address, port, console), daemon=True).start()

    try:
        serve(application(viewer), options.port, ready)
    finally:
        painted = viewer.painted_file()
        if painted is not None:
            console.log.warning("painted regions are in %s", painted)
        if viewer.work.running:
            console.log.warning("stopping the simulation")
            console.log.warning("%s", viewer.stop(wait_s=_WAIT_S)["said"])
    return 0


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    return f"keyframes that were saved are in {options.keyframes}"


def _text(address: str, port: int, anatomy: Anatomy, *, is_opened: bool) -> str:
    lines = [f"{anatomy.name} at {address}"]
    if not is_opened:
        lines.append(f"  {_from_afar(port)}")
    return "\n".join([*lines, "  Ctrl-C ends it"])


def _from_afar(port: int) -> str:
    return f"from another machine: ssh -L {port}:127.0.0.1:{port} THIS_MACHINE, then open that address"


def _open(address: str, port: int, console: Console) -> None:
    if not webbrowser.open(address):
        console.log.warning("no browser could be opened; open the address yourself, or %s", _from_afar(port))


def _without_regions(what: str) -> Anatomy:
    from naris.anatomy.folder import load_anatomy

    return load_anatomy(what)


def _model(path: Path, anatomy: Anatomy) -> tuple[Locate, Intrinsics, str]:
    """What a model says of pictures, its camera, and the name of its region set.

    Raises:
        CheckpointError: if it was made for another anatomy, where its poses mean nothing.
    """
    from naris.cli.models import open_model
    from naris.errors import CheckpointError
    from naris.locate import locate

    localizer = open_model(path)
    subject = localizer.checkpoint.subject
    if subject.anatomy_digest != anatomy.digest:
        raise CheckpointError(
            f"a model made for {anatomy.name}", f"one made for {subject.anatomy}", "train one on this anatomy"
        )
    return lambda image: locate([image], localizer)[0], subject.intrinsics, subject.regions.name


def _slices(options: Options, anatomy: Anatomy) -> Slices | None:
    if options.ct is None:
        return None
    from naris.anatomy.distance import lumen_distance
    from naris.ct.read import read_scan
    from naris.serve.slices import Slices

    return Slices(read_scan(options.ct).volume, lumen_distance(anatomy))


def _simulate(options: Options, regions: str | None) -> Simulate:
    def simulate(keyframes: Path, folder: Path, painted: Path | None, told: SimulationAsked, progress: Progress) -> int:
        from naris.cli import simulate as verb
        from naris.cli import views
        from naris.dataset.generate import simulate as simulated

        asked = verb.Options(
            options.anatomy,
            folder,
            keyframes=keyframes,
            regions=regions if painted is None else str(painted),
            per_position=told.per_position,
            step_mm=told.step_mm,
        )
        simulation, scene = views.simulation(asked)
        camera = simulation.intrinsics
        simulation = replace(simulation, intrinsics=told.camera(camera.width, camera.height))
        return len(simulated(simulation, folder, scene=scene, progress=progress))

    return simulate
