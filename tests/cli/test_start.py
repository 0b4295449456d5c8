"""The command line as a whole: what it prints where, and its exit status, whatever a verb does."""

from __future__ import annotations

import ast
import json
import os
import pty
import re
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import naris
from naris import cli
from naris.cli import VERBS, main

PROBE = '''
"""Does what a test asks for."""
import errno, logging, os, sys, time
from dataclasses import dataclass
from pathlib import Path
from naris.errors import DiskFull, PoseError

@dataclass(frozen=True)
class Options:
    """What to do."""
    what: str = "answer"
    """Which of the things."""
    step_mm: float = 1.5
    """How far, in mm."""

def run(options, console):
    print("a library chats")
    console.log.info("a notice")
    console.log.debug("a detail")
    console.log.warning("beware")
    if options.what == "answer":
        console.answer({"value": options.step_mm, "path": Path("a")}, f"value {options.step_mm} mm")
    elif options.what == "no":
        console.answer({"value": None}, "not localised")
        return 1
    elif options.what == "twice":
        console.answer({}, "one")
        console.answer({}, "two")
    elif options.what == "input":
        raise PoseError("a pose", "NaN", "remove it")
    elif options.what == "full":
        raise DiskFull("room", "none", "free some")
    elif options.what == "nameless":
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
    elif options.what == "missing":
        Path("/no/such/file").read_text()
    elif options.what == "memory":
        raise MemoryError("Unable to allocate 7.45 GiB for an array with shape (1000000000,)")
    elif options.what == "bug":
        raise KeyError("oops")
    elif options.what == "interrupt":
        raise KeyboardInterrupt
    elif options.what == "wait":
        with console.progress.task("wait", 100) as advance:
            for _ in range(100):
                advance(1)
                time.sleep(0.1)
    elif options.what == "bars":
        with console.progress.task("outer work", 3) as outer:
            for _ in range(3):
                with console.progress.task("inner work", 5) as inner:
                    for _ in range(5):
                        inner(1)
                        time.sleep(0.02)
                outer(1)
        console.answer({}, "done")
    elif options.what == "flood":
        console.answer({}, "x" * 10_000_000)
    return 0

def interrupted(options):
    return f"{options.what} keeps what it has; run it again"
'''
RUNNER = """
import sys
from naris import cli
cli.VERBS = {"probe": cli.Verb("naris_probe_verb", "does what a test asks for")}
sys.exit(cli.main())
"""


@pytest.fixture
def probe(tmp_path, monkeypatch):
    """A verb that behaves as asked, run in this process: gives (status, stdout, stderr)."""
    (tmp_path / "naris_probe_verb.py").write_text(PROBE)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(cli, "VERBS", {"probe": cli.Verb("naris_probe_verb", "does what a test asks for")})


@pytest.fixture
def process(tmp_path):
    """The same verb in a process of its own: gives the words that start it and its environment."""
    (tmp_path / "naris_probe_verb.py").write_text(PROBE)
    return [sys.executable, "-c", RUNNER, "probe"], {**os.environ, "PYTHONPATH": str(tmp_path)}


def run(*words: str) -> subprocess.CompletedProcess:
    return subprocess.run(
        [sys.executable, "-m", "naris", *words], capture_output=True, text=True, timeout=120, check=False
    )


# The overview -------------------------------------------------------------------------------------------------------


def test_help_lists_every_verb_and_needs_nothing_heavy() -> None:
    """Instead of the time, which a busy machine spoils: what was imported, counted by the interpreter itself."""
    program = "import sys; sys.argv = ['naris', '--help']; from naris.cli import main; status = main()\n"
    program += "print(' '.join(sys.modules), file=sys.stderr); sys.exit(status)"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    for name, verb in VERBS.items():
        assert re.search(rf"^  {name} +{re.escape(verb.summary)}$", done.stdout, re.MULTILINE)
    imported = {name.partition(".")[0] for name in done.stderr.split()}
    assert "naris" in imported
    assert not imported & {"numpy", "scipy", "numba", "torch", "tyro", "rich", "matplotlib", "jaxtyping", "cv2"}
    assert len(done.stderr.split()) < 150


def test_every_verb_that_is_listed_is_there() -> None:
    for name, verb in VERBS.items():
        module = re.sub("[ -]", "_", name)
        assert verb.module == f"naris.cli.{module}"
        tree = ast.parse((Path(cli.__file__).parent / f"{module}.py").read_text())
        assert ast.get_docstring(tree)
        defined = {node.name for node in tree.body if isinstance(node, (ast.FunctionDef, ast.ClassDef))}
        assert {"Options", "run"} <= defined


@pytest.mark.parametrize("name", list(VERBS))
def test_every_verb_tells_its_options_with_defaults(name: str) -> None:
    done = run(*name.split(), "--help")
    assert done.returncode == 0, done.stderr
    assert f"usage: naris {name}" in done.stdout
    assert "None" not in done.stdout
    rows = re.sub(r"[│╭╮╰╯─]", " ", done.stdout)
    options = re.split(r"\n  (?=-{1,2}[a-z])", rows)[1:]
    assert len(options) >= 1
    for option in options:
        words = " ".join(option.split())
        assert re.search(r"^-h|\((default: [^)]+|required|optional|repeatable)\)$", words), words
    assert done.stderr == ""


def test_version() -> None:
    assert run("--version").stdout == f"naris {naris.__version__}\n"


def test_without_words_the_overview(capsys) -> None:
    assert main([]) == 0
    assert "Usage: naris VERB" in capsys.readouterr().out


# Bad words ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["fetsch"], "there is no verb 'fetsch'; did you mean fetch? naris --help lists them"),
        (["zzzzz"], "there is no verb 'zzzzz'; naris --help lists them"),
        (["--json"], "expected a verb"),
        (["fetch"], "naris fetch --help tells the options"),
        (["fetch", "the-moon"], "mean-nose"),
        (["train", "a", "-o", "b", "--views", "x"], "expected --views anywhere, inspection or travel, got 'x'"),
        (["train", "a", "-o", "b", "--views", "None"], "--views"),
        (["train", "a", "-o", "b", "--steps", "None"], "expected --steps INT, got 'None'"),
        (["fetch", "mean-nose", "--attempts", "many"], "expected --attempts INT, got 'many'"),
        (["train", "a", "-o", "b", "--steps", "x"], "expected --steps INT, got 'x'"),
        (["demo", "--budget-s", "x"], "expected --budget-s FLOAT, got 'x'"),
        (["locate", "a.png", "-m", "b", "--probability", "x"], "expected --probability FLOAT, got 'x'"),
        (["locate", "a.png"], "expected -m MODEL, --model MODEL (Weights made by naris train: the file, or the folder"),
        (["train"], "drawn anew for every batch) and -o DIR, --out DIR (Folder of the training: new, or one that"),
        (["fetch", "mean-nose", "--atempts", "3"], "--atempts"),
    ],
)
def test_bad_words_get_one_line_and_status_2(capfd, words: list[str], says: str) -> None:
    assert main(words) == 2
    told = capfd.readouterr()
    assert told.err.count("\n") == 1
    assert told.err.startswith("naris: ")
    assert says in told.err
    assert "│" not in told.err


# What comes of a verb -----------------------------------------------------------------------------------------------


def test_the_answer_goes_to_stdout_and_the_rest_to_stderr(probe, capfd) -> None:
    assert main(["probe", "--step-mm", "2"]) == 0
    told = capfd.readouterr()
    assert told.out == "value 2.0 mm\n"
    assert told.err == "a library chats\na notice\nwarning: beware\n"


def test_json_is_one_object_wherever_the_flag_stands(probe, capfd) -> None:
    for words in (["probe", "--json"], ["--json", "probe"]):
        assert main(words) == 0
        assert json.loads(capfd.readouterr().out) == {"value": 1.5, "path": "a"}


def test_quiet_and_verbose(probe, capfd) -> None:
    main(["probe", "--quiet"])
    assert capfd.readouterr().err == "a library chats\nwarning: beware\n"
    main(["probe", "--verbose"])
    assert "a detail" in capfd.readouterr().err


def test_an_honest_no_is_status_1_with_an_answer(probe, capfd) -> None:
    assert main(["probe", "--what", "no", "--json"]) == 1
    assert json.loads(capfd.readouterr().out) == {"value": None}


@pytest.mark.parametrize(
    ("what", "kind", "says"),
    [
        ("input", "PoseError", "naris: expected a pose, got NaN; remove it\n"),
        ("full", "DiskFull", "naris: expected room, got none; free some\n"),
        (
            "nameless",
            "DiskFull",
            "naris: expected room on the disk, got No space left on device; free some and try again\n",
        ),
        (
            "memory",
            "OutOfMemory",
            "naris: expected memory enough for this, got none for another 7.45 GiB;"
            " crop the scan, end other programs or take a larger machine\n",
        ),
        ("missing", "FileNotFoundError", "naris: cannot use /no/such/file: No such file or directory\n"),
    ],
)
def test_errors_are_one_line_and_status_2(probe, capfd, what: str, kind: str, says: str) -> None:
    assert main(["probe", "--what", what]) == 2
    told = capfd.readouterr()
    assert told.out == ""
    assert told.err.endswith("beware\n" + says)
    assert main(["probe", "--what", what, "--json"]) == 2
    told = capfd.readouterr()
    assert json.loads(told.out)["error"]["kind"] == kind
    assert json.loads(told.out)["error"]["message"] in told.err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ("from-ct x.nrrd -o a --step-mm", "expected a value after --step-mm, got none"),
        ("from-ct x.nrrd -o a --step-mm --sinuses", "expected a value after --step-mm, got none"),
        ("from-ct x.nrrd -o", "expected a value after -o/--out, got none"),
        ("to-ct builtin -o a.nrrd --spacing-mm", "expected 3 values after --spacing-mm, got fewer"),
        ("to-ct builtin -o a.nrrd --spacing-mm 1 2", "expected 3 values after --spacing-mm, got fewer"),
        ("sample -o a --variant", "expected a value after --variant, got none"),
        ("from-ct x.nrrd -o a --spacing-mm", "expected options of this verb, got --spacing-mm, which it does not have"),
        ("from-ct x.nrrd -o a --nope 1", "expected options of this verb, got --nope, 1, which it does not have"),
    ],
)
def test_an_option_without_its_value_or_without_a_verb_gets_one_sentence(words: str, says: str, capfd) -> None:
    verb = words.split()[0]
    assert main(["anatomy", *words.split()]) == 2
    assert capfd.readouterr().err == f"naris: {says}; naris anatomy {verb} --help tells the options\n"


def test_a_bug_shows_its_traceback_and_says_that_it_is_one(probe, capfd) -> None:
    for what in ("bug", "twice"):
        assert main(["probe", "--what", what]) == 70
        told = capfd.readouterr()
        assert "Traceback" in told.err
        assert told.err.splitlines()[-1].startswith(f"naris: this is a bug in naris {naris.__version__}")


def test_an_interrupt_says_what_was_kept(probe, capfd) -> None:
    assert main(["probe", "--what", "interrupt"]) == 130
    assert capfd.readouterr().err.endswith("naris: interrupted: interrupt keeps what it has; run it again\n")


def test_control_c_in_a_real_process(process) -> None:
    words, environment = process
    with subprocess.Popen(
        [*words, "--what", "wait"], env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        while "beware" not in running.stderr.readline():
            pass
        time.sleep(0.2)
        running.send_signal(signal.SIGINT)
        _, err = running.communicate(timeout=20)
    assert running.returncode == 130
    assert err == "naris: interrupted: wait keeps what it has; run it again\n"


def test_a_reader_that_leaves_is_no_error(process) -> None:
    words, environment = process
    script = f'{" ".join(map(repr, words[:1]))} "$@" | head -c 10; echo ${{PIPESTATUS[0]}}'
    done = subprocess.run(
        ["bash", "-c", script, "bash", *words[1:], "--what", "flood", "--quiet"],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout == "x" * 10 + "141\n"
    assert done.stderr == "a library chats\nwarning: beware\n"


def on_terminal(words: list[str], environment: dict[str, str]) -> tuple[int, str]:
    """Runs with stderr on a terminal; gives the status and what the terminal was sent."""
    ours, theirs = pty.openpty()
    environment = {**environment, "TERM": "xterm", "COLUMNS": "100"}
    shown = b""
    with subprocess.Popen(words, env=environment, stdout=subprocess.DEVNULL, stderr=theirs) as running:
        os.close(theirs)
        while select.select([ours], [], [], 20)[0]:
            try:
                shown += os.read(ours, 1 << 16)
            except OSError:  # the terminal was hung up
                break
    os.close(ours)
    return running.returncode, shown.decode()


def test_progress_bars_only_on_a_terminal(process) -> None:
    words, environment = process
    status, shown = on_terminal([*words, "--what", "bars"], environment)
    assert status == 0
    assert "outer work" in shown
    assert "inner work" in shown
    assert "3/3" in shown
    _, quiet = on_terminal([*words, "--what", "bars", "--quiet"], environment)
    assert "outer work" not in quiet
    piped = subprocess.run([*words, "--what", "bars"], env=environment, capture_output=True, text=True, check=True)
    assert "work" not in piped.stderr
    assert piped.stdout == "done\n"
