"""Starts a verb and turns whatever comes of it into an exit status."""

from __future__ import annotations

import difflib
import errno
import importlib
import io
import os
import re
import sys
import traceback
from collections.abc import Mapping, Sequence
from contextlib import nullcontext, redirect_stderr, redirect_stdout
from types import ModuleType, TracebackType
from typing import TYPE_CHECKING, Any

import naris
from naris.cli.console import Console, console_for
from naris.cli.options import check_numbers
from naris.core.atomic import check_reachable, to_json
from naris.core.held import held
from naris.errors import InputError, NarisError, OutOfMemory

if TYPE_CHECKING:
    from naris.cli import Verb

BAD_INPUT, BUG, INTERRUPTED, BROKEN_PIPE = 2, 70, 130, 141
_FRAME = re.compile(r"^[│╭╰─╮╯|\s]+|[│╭╰─╮╯|\s]+$")
_NAME_INDENT = "│     "
_UNFIT = re.compile(
    r"Error parsing (?P<option>\S+): (?:no type matching |invalid literal for |could not convert string to )"
    r"(?P<kind>\S+?)(?: could be instantiated from|\(\) with base 10:|:) \[?(?P<given>'.*?')\]?\.?$"
)
_CHOICE = re.compile(
    r"invalid choice (?P<given>'.*') for argument '(?P<option>\S+)'\. Expected one of \((?P<those>.*)\)\.$"
)
_VALUELESS = re.compile(r"Missing value for argument '(?P<option>\S+)'\.(?: Expected (?P<count>\S+) values\.)?")
_UNKNOWN_OPTIONS = re.compile(r"Unrecognized options: (?P<those>.+)$")
_OF_EVERY_VERB = "Also of every verb: --json, --quiet, --verbose (naris --help)."
_KINDS = {"int": "INT", "float": "FLOAT"}


def start(words: Sequence[str], flags: set[str], verbs: Mapping[str, Verb]) -> int:
    """Runs the verb that `words` begin with, in the manner that the `flags` of every verb ask for."""
    console = console_for(flags)
    with _Outcome(console) as outcome:
        name = next((first for count in (2, 1) if (first := " ".join(words[:count])) in verbs), None)
        if name is None:
            raise InputError(_unknown(words, verbs))
        if len(words) > 1 and name == words[0] and (near := _near_sub(words, verbs)):
            raise InputError(f"there is no verb {' '.join(words[:2])!r}; did you mean {near}? naris --help lists them")
        module = importlib.import_module(verbs[name].module)
        outcome.verb = module
        outcome.options = _options(module, name, words[len(name.split()) :])
        check_numbers(outcome.options)
        out = getattr(outcome.options, "out", None)
        if out is not None:
            check_reachable(out)
        # A library that prints must not get in the way of the answer.
        with redirect_stdout(sys.stderr), nullcontext() if out is None else held(out):
            outcome.status = module.run(outcome.options, console)
    return outcome.status


class _Outcome:
    """What a verb came to: its exit status, and the line that goes with it."""

    def __init__(self, console: Console) -> None:
        self.status = 0
        self.verb: ModuleType | None = None
        self.options: Any = None
        self._console = console

    def __enter__(self) -> _Outcome:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, where: TracebackType | None
    ) -> bool:
        if error is None:
            return False
        if isinstance(error, SystemExit):
            self.status = error.code if isinstance(error.code, int) else 0 if error.code is None else BAD_INPUT
        elif isinstance(error, BrokenPipeError):
            self.status = BROKEN_PIPE
            # Whoever read has left: the interpreter must not try to flush again when it ends.
            os.dup2(os.open(os.devnull, os.O_WRONLY), self._console.out.fileno())
        elif isinstance(error, KeyboardInterrupt):
            self.status = INTERRUPTED
            self._fail("Interrupted", f"interrupted: {self._kept()}")
        elif isinstance(error, NarisError):
            self.status = BAD_INPUT
            self._fail(type(error).__name__, str(error))
        elif isinstance(error, OSError) and error.errno in (errno.ENOSPC, errno.EDQUOT):
            self.status = BAD_INPUT
            where_to = "" if error.filename is None else f" to write {error.filename}"
            self._fail(
                "DiskFull", f"expected room on the disk{where_to}, got {error.strerror}; free some and try again"
            )
        elif isinstance(error, OSError) and error.filename is not None:
            self.status = BAD_INPUT
            self._fail(type(error).__name__, f"cannot use {error.filename}: {error.strerror}")
        elif isinstance(error, MemoryError):
            self.status = BAD_INPUT
            self._fail("OutOfMemory", str(OutOfMemory.of("for this", error)))
        else:
            self.status = BUG
            traceback.print_exception(kind, error, where)
            self._fail("Bug", f"this is a bug in naris {naris.__version__}: please report the lines above")
        return True

    def _kept(self) -> str:
        tell = getattr(self.verb, "interrupted", None)
        if tell is None or self.options is None:
            return "nothing is half-written; run the same command again"
        return str(tell(self.options))

    def _fail(self, kind: str, message: str) -> None:
        print(f"naris: {message}", file=sys.stderr, flush=True)
        if self._console.json and not self._console.answered:
            print(to_json({"error": {"kind": kind, "message": message}}), file=self._console.out, flush=True)


def _near_sub(words: Sequence[str], verbs: Mapping[str, Verb]) -> str | None:
    """The verb of two words that was meant by one that is nothing else either."""
    several = [verb for verb in verbs if verb.startswith(f"{words[0]} ")]
    if words[1].startswith("-") or os.path.exists(words[1]):  # noqa: PTH110  (a word too long for a path is none)
        return None
    near = difflib.get_close_matches(" ".join(words[:2]), several, n=1, cutoff=0.85)
    return near[0] if near else None


def _options(module: ModuleType, name: str, words: Sequence[str]) -> Any:
    """The verb's options from its words; `--help` prints them and ends the program.

    Raises:
        InputError: if a word is missing, unknown or of the wrong kind, in one line.
    """
    import tyro

    told = io.StringIO()
    try:
        with redirect_stderr(told):
            described = f"{module.__doc__}\n\n{_OF_EVERY_VERB}"
            return tyro.cli(module.Options, prog=f"naris {name}", description=described, args=list(words))
    except SystemExit as stop:
        if not stop.code:
            raise
        raise InputError(f"{_one_line(told.getvalue())}; naris {name} --help tells the options") from None


def _one_line(box: str) -> str:
    """The first paragraph of tyro's framed message, without its title; what is missing as a list."""
    framed = box.splitlines()[1:]
    rows = [_FRAME.sub("", row) for row in framed]
    end = rows.index("") if "" in rows else len(rows)
    if rows and rows[0].startswith("Missing from") and (missing := _missing(framed[1:end])):
        return f"expected {missing}, got none"
    said = " ".join(rows[:end])
    if unfit := _UNFIT.match(said):
        return f"expected {unfit['option']} {_KINDS.get(unfit['kind'], unfit['kind'])}, got {unfit['given']}"
    if valueless := _VALUELESS.match(said):
        return _without_value(valueless["option"], valueless["count"])
    if unknown := _UNKNOWN_OPTIONS.match(said):
        return f"expected options of this verb, got {unknown['those']}, which it does not have"
    if choice := _CHOICE.match(said):
        # Of an option that need not be given, tyro names `None` as well, and all in an order of chance.
        *others, last = sorted(set(re.findall(r"'(.*?)'", choice["those"])) - {"None"})
        those = f"{', '.join(others)} or {last}" if others else last
        return f"expected {choice['option']} {those}, got {choice['given']}"
    return said


def _without_value(option: str, count: str | None) -> str:
    """What an option lacks; tyro counts the values that it takes, and not those that came."""
    if count is not None and count.isdecimal() and int(count) > 1:
        return f"expected {count} values after {option}, got fewer"
    return f"expected a value after {option}, got none"


def _missing(framed: Sequence[str]) -> str:
    """`-m MODEL, --model MODEL (Weights made by naris train)`: names stand four columns in, what they mean eight."""
    told: list[tuple[str, list[str]]] = []
    for row in framed:
        text = _FRAME.sub("", row)
        if row.startswith(_NAME_INDENT) and not row.startswith(_NAME_INDENT + " "):
            told.append((text, []))
        elif told:
            told[-1][1].append(text)
    return " and ".join(f"{name} ({_first_sentence(' '.join(meaning))})" for name, meaning in told)


def _first_sentence(text: str) -> str:
    return text.replace(" (required)", "").partition(". ")[0].removesuffix(".")


def _unknown(words: Sequence[str], verbs: Mapping[str, Verb]) -> str:
    if not words:
        return "expected a verb; naris --help lists them"
    near = difflib.get_close_matches(words[0], verbs, n=3, cutoff=0.6)
    hint = f"did you mean {' or '.join(near)}? " if near else ""
    return f"there is no verb {words[0]!r}; {hint}naris --help lists them"
