"""What every test may use: shape checks switched on over the whole package, and the data of the project where it is.

`naris` is imported under jaxtyping + beartype, so a wrong shape or dtype fails in any test; `test_shape_checks.py`
is the canary that fails when this is off. Data for development lies in `../shared/data` beside the checkout
(or where `NARIS_TEST_DATA` points); tests that use it skip, saying so, where it is absent.
"""

from __future__ import annotations

import ast
import os
import signal
from collections import Counter
from pathlib import Path

import hypothesis
import jaxtyping._import_hook as import_hook
import pytest

_COMPILERS = {"njit", "jit", "vectorize", "guvectorize", "cfunc", "stencil", "kernel"}
_SLOW = 20
"""How many other tests one marked so weighs."""

_is_unchecked = import_hook._is_no_type_check


def _is_compiled(decorator: ast.AST) -> bool:
    """Whether a decorator hands its function to numba, which reads bytecode and cannot look through a wrapper."""
    if isinstance(decorator, ast.Call):
        return _is_compiled(decorator.func)
    name = getattr(decorator, "attr", None) or getattr(decorator, "id", "")
    return name.lstrip("_") in _COMPILERS or name.endswith("jit")


import_hook._is_no_type_check = lambda node: _is_unchecked(node) or _is_compiled(node)
# An int is as good as a float, as type checkers have it (PEP 484).
TYPECHECKER = "beartype.beartype(conf=beartype.BeartypeConf(is_pep484_tower=True))"
import_hook.install_import_hook("naris", TYPECHECKER)

# A busy machine is no fault of the code; under CI the same examples every time.
hypothesis.settings.register_profile("naris", deadline=None, derandomize="CI" in os.environ)
hypothesis.settings.load_profile("naris")

# A shell that starts the tests in the background has them ignore Ctrl-C, and every process that they start as well.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_configure(config: pytest.Config) -> None:
    """The processes of a run share the cores: where the threads of each take all of them, they wait for each other.

    Said before the processes start, as numpy and torch read it when they are loaded.
    """
    processes = getattr(config.option, "numprocesses", None)  # of pytest-xdist
    if isinstance(processes, int) and processes > 0:
        os.environ.setdefault("OMP_NUM_THREADS", str(max(len(os.sched_getaffinity(0)) // processes, 1)))


@pytest.hookimpl(tryfirst=True)  # before tests are chosen by their marks
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests come first: processes take files in this order, and none shall begin a long one last."""
    for item in items:
        if item.get_closest_marker("long"):
            item.add_marker(pytest.mark.slow)
    weight = Counter(item.path for item in items)
    weight.update({path: _SLOW * n for path, n in Counter(i.path for i in items if _is_slow(i)).items()})
    items.sort(key=lambda item: -weight[item.path])


def _is_slow(item: pytest.Item) -> bool:
    return item.get_closest_marker("slow") is not None


REPOSITORY = Path(__file__).resolve().parents[1]
SHARED_DATA = Path(os.environ.get("NARIS_TEST_DATA") or REPOSITORY.parent / "shared" / "data")


def shared_file(relative: str) -> Path:
    """A file of the development data; the calling test skips where it is absent."""
    path = SHARED_DATA / relative
    if not path.exists():
        pytest.skip(f"development data {relative} is absent (set NARIS_TEST_DATA to its folder)")
    return path


@pytest.fixture(scope="session", autouse=True)
def shared_by_processes(tmp_path_factory: pytest.TempPathFactory) -> None:
    """Where the processes of a run keep what only one of them shall make (`tests.simulated_head`)."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        os.environ["NARIS_TESTS_SHARED"] = str(tmp_path_factory.getbasetemp().parent)


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of the development data."""
    return shared_file("")


@pytest.fixture(scope="session")
def mean_nose_ply() -> Path:
    """The surface of the published mean nose."""
    return shared_file("mean-nose/ASR.ply")


@pytest.fixture(scope="session")
def mean_nose_texture() -> Path:
    """The texture that the published experiment put on the mean nose."""
    return next(iter(sorted(shared_file("mean-nose").glob("*texture*"))))
