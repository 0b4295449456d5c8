"""The command line: `naris VERB …`, one verb a stage, each in a module of its own.

A verb is a module with a frozen dataclass `Options` (its command line is generated from it) and
`run(options, console) -> int`. It is imported when it is called, so that `naris --help` answers at once. A verb of two
words is a branch of the first (`naris anatomy from-ct`).

Exit status: 0 the answer is there; 1 the work ran and the honest answer is "no"; 2 bad input, in one line on stderr;
70 a bug, with a traceback; 130 interrupted.
"""

from __future__ import annotations

import sys
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import naris


class Verb(NamedTuple):
    """Where a verb lives and what it does, in one line."""

    module: str
    summary: str


VERBS: Mapping[str, Verb] = {
    "demo": Verb("naris.cli.demo", "the whole pipeline on the built-in nose, with a report, in about five minutes"),
    "reproduce": Verb("naris.cli.reproduce", "the published experiment on the mean nose, and what it leaves open"),
    "anatomy": Verb("naris.cli.anatomy", "look at an anatomy, keep it with regions, passages and a picture"),
    "anatomy from-ct": Verb("naris.cli.anatomy_from_ct", "the airway of the nose in a CT, as an anatomy"),
    "anatomy inspect": Verb("naris.cli.anatomy_inspect", "what a CT is and whether it will do"),
    "anatomy transfer": Verb("naris.cli.anatomy_transfer", "regions for an anatomy, carried from others"),
    "anatomy shape-model": Verb("naris.cli.anatomy_shape_model", "a mean nose and how noses differ from it"),
    "anatomy sample": Verb("naris.cli.anatomy_sample", "virtual patients, from normal ranges or other anatomies"),
    "anatomy to-ct": Verb("naris.cli.anatomy_to_ct", "the CT that a scanner would make of an anatomy"),
    "steer": Verb("naris.cli.steer", "steer the scope through an anatomy in the browser, save keyframes"),
    "simulate": Verb("naris.cli.simulate", "pictures of an anatomy with poses, regions and depth"),
    "train": Verb("naris.cli.train", "a network, on views rendered as it learns or on a data set"),
    "evaluate": Verb("naris.cli.evaluate", "how good a model is: accuracy, confusion, calibration, pose errors"),
    "locate": Verb("naris.cli.locate", "region and pose of any picture, or that it cannot be told"),
    "register": Verb(
        "naris.cli.register", "the camera's pose in an anatomy from depth, points or a picture, or that it is unsure"
    ),
    "bench": Verb("naris.cli.bench", "measure the figures that the documents quote"),
    "fetch": Verb("naris.cli.fetch", "download public data with pinned digests: mean-nose"),
}
"""Every verb that works, in the order of the pipeline."""

_GLOBAL_OPTIONS = {
    "--json": "print one JSON object on stdout and nothing else there",
    "--quiet": "on stderr only warnings and errors, no progress bars",
    "--verbose": "on stderr also what helps to find a fault",
}


def main(arguments: Sequence[str] | None = None) -> int:
    """Runs one verb and gives the exit status; `arguments` as after the program's name, by default the process's."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    flags = {word for word in given if word in _GLOBAL_OPTIONS}
    words = [word for word in given if word not in flags]
    if not given or words[:1] in (["-h"], ["--help"], ["help"]):
        return _print(_overview())
    if words[:1] in (["-V"], ["--version"]):
        return _print(f"naris {naris.__version__}")
    from naris.cli.start import start  # what a verb needs is not needed for the overview

    return start(words, flags, VERBS)


def _overview() -> str:
    width = max(len(name) for name in [*VERBS, *_GLOBAL_OPTIONS]) + 2
    lines = [
        naris.__doc__ or "naris",
        "",
        "Usage: naris VERB [OPTIONS]      naris VERB --help tells a verb's options with units and defaults",
        "",
        "Verbs:",
        *(f"  {name:<{width}}{verb.summary}" for name, verb in VERBS.items()),
        "",
        "Options of every verb:",
        *(f"  {name:<{width}}{meaning}" for name, meaning in _GLOBAL_OPTIONS.items()),
        "",
        "Exit status: 0 done, 1 the honest answer is no, 2 bad input (one line says what), 130 interrupted.",
    ]
    return "\n".join(lines)


def _print(text: str) -> int:
    try:
        print(text, flush=True)
    except BrokenPipeError:
        sys.stdout = None  # nobody reads, and the interpreter must not try again
    return 0
