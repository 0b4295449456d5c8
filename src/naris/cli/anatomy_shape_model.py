"""Build a shape model: a mean nose and the ways in which noses differ from it, to draw virtual patients from."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from naris.cli.console import Console
from naris.cli.options import IfGiven, refuse

if TYPE_CHECKING:
    from naris.anatomy.shape_model import ShapeModel
    from naris.core.anatomy import Anatomy

PAGE = "shape_model.html"
_VIRTUAL = 24


@dataclass(frozen=True)
class Options:
    """Of whom, and where to."""

    patients: Annotated[
        tyro.conf.Positional[tuple[str, ...]], tyro.conf.arg(metavar="ANATOMY", help_behavior_hint="(optional)")
    ] = ()
    """Three anatomies of patients or more, each once, such as folders of naris anatomy from-ct or sample; by default
    virtual noses."""
    out: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="DIR")] = Path("out/shape-model")
    """Folder for the model: new, empty, or one made by this command."""
    reference: Annotated[str, tyro.conf.arg(metavar="ANATOMY")] = "builtin"
    """Whose mesh, regions and passages the model has; its own shape counts only if it is given as a patient, too."""
    virtual: IfGiven[int] = None
    """How many virtual noses to build it of, 3 to 100; 24 when not given. Not with patients."""


def run(options: Options, console: Console) -> int:
    """Lays the reference on every patient, and keeps the mean and the modes, with a page on how good they are."""
    from naris.anatomy.correspondence import check_laid
    from naris.anatomy.shape_model import DESCRIPTION, FEWEST, MEAN, MODES, build_shape_model, save_shape_model
    from naris.anatomy.transfer import virtual_references
    from naris.cli.anatomies import open_anatomy
    from naris.cli.folders import check_own
    from naris.core.atomic import write_text
    from naris.errors import InputError
    from naris.report.shape_model_page import shape_model_page

    if not (options.out / DESCRIPTION).is_file():  # which is written last: the others may be of a run that was stopped
        check_own(options.out, (MEAN, MODES, PAGE), "a shape model")
    reference, _ = open_anatomy(options.reference)
    if options.patients:
        refuse(options, ("virtual",), "without patients", f"{len(options.patients)} of them")
        patients = [open_anatomy(one)[0] for one in options.patients]
        _check_once(options.patients, patients)
        for patient in patients:
            check_laid(patient)
    else:
        count, patients = options.virtual or _VIRTUAL, []
        if count < FEWEST:
            raise InputError(f"--virtual {FEWEST} or more", f"{count}", "a model needs some noses to differ")
        with console.progress.task("virtual noses", count) as advance:
            for number, nose in enumerate(virtual_references(count + 1)):
                if number:  # the first is the built-in nose itself
                    patients.append(nose)
                    advance(1)
    model = build_shape_model(reference, patients, console.progress)
    data = _describe(model, options.out)
    (options.out / PAGE).unlink(missing_ok=True)  # no model shall stand beside the page of another
    save_shape_model(model, options.out)
    write_text(options.out / PAGE, shape_model_page(model, _facts(data)))
    console.answer(data, _text(data))
    return 0


def _check_once(words: tuple[str, ...], patients: list[Anatomy]) -> None:
    """See that no patient counts twice."""
    from naris.errors import InputError

    known: dict[str, str] = {}
    for word, patient in zip(words, patients, strict=True):
        if patient.digest in known:
            got = f"the same nose in {known[patient.digest]} and {word}"
            raise InputError("every patient once", got, "leave one of them out")
        known[patient.digest] = word


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    return "no whole model was kept; run the same command again"


def _describe(model: ShapeModel, folder: Path) -> dict[str, Any]:
    curves = vars(model.curves) if model.curves is not None else {}
    return {
        "patients": model.patients,
        "modes": len(model.share),
        "share": [round(float(one), 4) for one in model.share],
        "residual_mm": round(model.residual_mm, 3),
        **{name: values.round(4).tolist() for name, values in curves.items()},
        "mean_digest": model.mean.digest,
        "folder": folder,
        "page": folder / PAGE,
    }


def _facts(data: dict[str, Any]) -> dict[str, str]:
    """What the model is and how good, with as many modes as it keeps, or as many as there are when one is left out."""
    first = ", ".join(f"{100 * one:.0f} %" for one in data["share"][:4])
    modes = data["modes"]
    kept = min(modes, len(data["generalisation_mm"]) - 1)
    mean_mm, missed_mm = data["generalisation_mm"][0], data["generalisation_mm"][kept]
    drawn_mm = data["specificity_mm"][modes]
    return {
        "modes": f"{modes}, the first of them {first} of the variance",
        "residual": f"laid on the patients, the reference is {data['residual_mm']:.2f} mm off their surfaces",
        "generalisation": f"a nose left out is met within {missed_mm:.2f} mm by {_modes(kept)} of the others, "
        f"within {mean_mm:.2f} mm by their mean",
        "specificity": f"a nose drawn with {_modes(modes)} is {drawn_mm:.2f} mm off the nearest of them",
    }


def _modes(count: int) -> str:
    return "1 mode" if count == 1 else f"{count} modes"


def _text(data: dict[str, Any]) -> str:
    lines = [f"shape model of {data['patients']} noses"]
    lines += [f"  {label:<15}{said}" for label, said in _facts(data).items()]
    lines.append(f"kept in {data['folder']}, page in {data['page']}")
    lines.append(f"naris anatomy sample --model {data['folder']} draws patients from it")
    return "\n".join(lines)
