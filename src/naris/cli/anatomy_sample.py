"""Make virtual patients, each an anatomy like any other: from the normal ranges of a nose, from a shape model, or by
smooth deformations of one anatomy.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from naris.cli.console import Console
from naris.cli.options import IfGiven, refuse

if TYPE_CHECKING:
    from naris.anatomy.drawn import Drawn

PATIENTS = "patients.json"
SCHEMA = "naris.patients/1"
SOME_MISSING = 1
_OF_TWO_SIDES = ("asymmetry", "cycle_mm")
_OF_A_PROCESS = ("amplitude_mm", "scale_mm", *_OF_TWO_SIDES)
_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Options:
    """How many, and where to."""

    out: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="DIR")]
    """Folder for the patients, each in a folder of its own: new, empty, or one made by this command with that seed."""
    count: int = 10
    """How many there shall be; those that are there already are kept."""
    seed: int = 0
    """Of the population. A patient depends on it and on its number alone."""
    model: Annotated[IfGiven[Path], tyro.conf.arg(metavar="DIR")] = None
    """A shape model (naris anatomy shape-model) to draw from, which is quicker; when not given, the parameters of the
    built-in nose are drawn from their normal ranges."""
    variant: IfGiven[
        Literal[
            "deviated-septum",
            "turbinate-hypertrophy",
            "concha-bullosa",
            "septal-perforation",
            "after-sinus-surgery",
            "polyps",
        ]
    ] = None
    """What is not normal in the built-in nose: each patient has it, of another size. Not with --model or --around."""
    around: Annotated[IfGiven[str], tyro.conf.arg(metavar="ANATOMY")] = None
    """An anatomy to deform smoothly instead: `builtin`, a folder, a surface file. Not with --model."""
    amplitude_mm: IfGiven[float] = None
    """How far points move, in mm along each axis (standard deviation), 0 to 5; 0.8 when not given. Beyond 3
    few draws leave the passages of a nose open. Only with --around."""
    scale_mm: IfGiven[float] = None
    """Over how many mm points move alike, above 0; 12 when not given. Only with --around."""
    asymmetry: IfGiven[float] = None
    """From 0, both sides as mirror images, to 1, each on its own; 0.3 when not given. Only with --around."""
    cycle_mm: IfGiven[float] = None
    """The nasal cycle: how far the mucosa of one side swells and the other's shrinks, in mm (standard deviation); 0.4
    when not given. Only with --around."""
    pictures: bool = False
    """Draw each patient as a page, anatomy.html in its folder, too; those that are there already as well."""


def run(options: Options, console: Console) -> int:
    """Makes the patients that are not there yet, and pictures of them if asked."""
    from naris.anatomy.drawn import told
    from naris.anatomy.folder import DESCRIPTION, load_anatomy, save_anatomy
    from naris.cli.anatomy import PICTURE, draw_page
    from naris.errors import NarisError

    draw, drawn_from = _population(options)
    _claim(options, drawn_from)
    made: list[dict[str, Any]] = []
    missing: list[int] = []
    with console.progress.task("virtual patients", options.count) as advance:
        for number in range(options.count):
            folder = options.out / f"{number:04d}"
            if not (folder / DESCRIPTION).is_file():
                try:
                    drawn = draw(options.seed, number)
                except NarisError as error:
                    _log.warning("no patient %d: %s", number, error)
                    missing.append(number)
                else:
                    save_anatomy(drawn.anatomy, folder)
                    made.append({"folder": folder, **_told(drawn)})
            if options.pictures and (folder / DESCRIPTION).is_file() and not (folder / PICTURE).is_file():
                draw_page(load_anatomy(str(folder)), folder)
            advance(1)
    data = {"seed": options.seed, "count": options.count, "made": made, "missing": missing, "folder": options.out}
    passed_over = dict(sum((Counter(one["passed_over"]) for one in made), Counter[str]()))
    over = f"; {told(passed_over)}" if made else ""
    kept = options.count - len(made) - len(missing)
    patients = "patient" if len(made) == 1 else "patients"
    already = f", {kept} {'was' if kept == 1 else 'were'} there already" if kept else ""
    none = f"; no nose came of {len(missing)} more, which stay missing" if missing else ""
    pictured = f", each with a picture ({PICTURE})" if options.pictures else ""
    console.answer(
        data | {"passed_over": passed_over},
        f"{len(made)} virtual {patients} made in {options.out}{already}{pictured}{over}{none}",
    )
    return SOME_MISSING if missing else 0


def _population(options: Options) -> tuple[Callable[[int, int], Drawn], str]:
    """What draws a patient from a seed and a number, and what it is called."""
    if options.model is not None or options.around is not None:
        refuse(options, ("variant",), "only with the built-in nose and its ranges", "--model or --around")
    if options.around is None:
        refuse(options, _OF_A_PROCESS, "only with --around", "none")
    if options.model is not None:
        from naris.anatomy.shape_model import load_shape_model

        refuse(options, ("around",), "without a shape model", f"--model {options.model}")
        model = load_shape_model(options.model)
        return model.draw, f"shape model of mean {model.mean.digest[:16]}"
    if options.around is not None:
        from naris.anatomy.gaussian_process import Deformation, GaussianProcess
        from naris.cli.anatomies import open_anatomy

        given = {name: value for name in _OF_A_PROCESS if (value := getattr(options, name)) is not None}
        deformation = Deformation(**given)
        anatomy, _ = open_anatomy(options.around)
        process = GaussianProcess.around(anatomy, deformation)
        if not process.has_sides:
            refuse(options, _OF_TWO_SIDES, "only with landmarks of both sides", f"none in {anatomy.name}")
        told = ", ".join(f"{name} {getattr(deformation, name):g}" for name in _OF_A_PROCESS)
        return process.draw, f"process around {anatomy.digest[:16]}, {told}"
    from naris.anatomy.builtin.variation import draw_patient

    if options.variant is not None:
        variant = options.variant.replace("-", " ")
        return partial(draw_patient, variant=variant), f"normal ranges and {variant}"
    return draw_patient, "normal ranges"


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    return f"the patients made so far are in {options.out}; the same command goes on from there"


def _claim(options: Options, drawn_from: str) -> None:
    """See that the folder is this population's, or make it so."""
    import json

    from naris.cli.folders import check_own
    from naris.core.atomic import write_json
    from naris.errors import ConfigurationChanged

    out, path = options.out, options.out / PATIENTS
    wanted = {"seed": options.seed, "drawn_from": drawn_from}
    if path.is_file():
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            known = {name: content[name] for name in wanted}
        except (ValueError, LookupError, TypeError):
            known = {}
        if known != wanted:
            raise ConfigurationChanged(
                f"virtual patients of {_words(wanted)} in {out}", _words(known), "give another folder"
            )
        return
    check_own(out, (), PATIENTS)
    write_json(path, {"schema": SCHEMA, **wanted})


def _words(population: dict[str, Any]) -> str:
    return f"seed {population['seed']} from the {population['drawn_from']}" if population else "something else"


def _told(drawn: Drawn) -> dict[str, Any]:
    nose = drawn.anatomy
    return {"name": nose.name, "digest": nose.digest, "source": nose.source, "passed_over": dict(drawn.passed_over)}
