"""What is exported, what imports what, and that the files that set everything up agree with each other."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
import tomllib
from importlib import metadata

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

import naris
from tests.conftest import REPOSITORY

EXPORTED: tuple[str, ...] = ()
"""What `import naris` gives, besides the version. Whoever adds a name here promises to keep it."""

README = (REPOSITORY / "README.md").read_text()
PROJECT = tomllib.loads((REPOSITORY / "pyproject.toml").read_text())["project"]
PINS = {
    canonicalize_name(name): version
    for name, _, version in (
        line.partition("==")
        for line in (REPOSITORY / "constraints.txt").read_text().splitlines()
        if not line.startswith("#")
    )
}


def requirements() -> list[Requirement]:
    extras = [line for lines in PROJECT["optional-dependencies"].values() for line in lines]
    return [Requirement(line) for line in [*PROJECT["dependencies"], *extras]]


def test_the_import_contracts_hold() -> None:
    done = subprocess.run(
        [sys.executable, "-c", "from importlinter.cli import lint_imports_command; lint_imports_command()"],
        cwd=REPOSITORY,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout


def test_importing_the_package_imports_nothing_heavy() -> None:
    program = "import sys, naris, naris.errors; print(' '.join(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert not {name.partition(".")[0] for name in done.stdout.split()} & {"numpy", "torch", "numba", "matplotlib"}


def test_the_public_face() -> None:
    program = "import naris; print(' '.join(sorted(name for name in dir(naris) if not name.startswith('_'))))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert tuple(done.stdout.split()) == EXPORTED
    assert re.fullmatch(r"\d+\.\d+\.\d+", naris.__version__)
    assert metadata.version("naris") == naris.__version__


@pytest.mark.parametrize("requirement", requirements(), ids=lambda requirement: requirement.name)
def test_every_dependency_is_pinned_within_its_range(requirement: Requirement) -> None:
    if requirement.name == "naris":
        return
    assert PINS[canonicalize_name(requirement.name)] in requirement.specifier


def imported(folder: str) -> set[str]:
    """The distributions that the code below a folder imports, anywhere in it."""
    owners = metadata.packages_distributions()
    names: set[str] = set()
    for path in (REPOSITORY / folder).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Import):
                names |= {alias.name.partition(".")[0] for alias in node.names}
            elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
                names.add(node.module.partition(".")[0])
    beside = {path.stem for path in (REPOSITORY / folder).glob("*.py")}  # scripts share what lies beside them
    foreign = names - set(sys.stdlib_module_names) - {"naris", "tests"} - beside
    return {canonicalize_name(name) for module in foreign for name in owners.get(module, [module])}


def test_what_is_imported_is_declared_and_nothing_else() -> None:
    def declared(lines: list[str]) -> set[str]:
        return {canonicalize_name(Requirement(line).name) for line in lines}

    product, extras = declared(PROJECT["dependencies"]), PROJECT["optional-dependencies"]
    optional = [line for name in ("vtk", "peers", "browser", "small-gicp", "open3d") for line in extras[name]]
    assert imported("src") - declared(optional) == product
    slicer = {"slicer"}  # what `make slicer` runs in an environment of its own
    assert imported("tests") - slicer <= product | declared(extras["test"])
    assert imported("docs") <= product | declared(extras["docs"])


def test_pins_are_exact_versions_from_nowhere_in_particular() -> None:
    for name, version in PINS.items():
        assert re.fullmatch(r"[0-9][0-9a-z.]*", version), f"{name}=={version}"


def test_the_promised_pythons_agree() -> None:
    assert PROJECT["requires-python"] == ">=3.11,<3.14"
    assert "(3, 11) <= sys.version_info[:2] < (3, 14)" in (REPOSITORY / "Makefile").read_text()
    classified = {entry.rsplit(" ", 1)[1] for entry in PROJECT["classifiers"] if ":: 3." in entry}
    assert classified == {"3.11", "3.12", "3.13"}


def test_no_dependency_is_copyleft() -> None:
    """Of everything that naris needs to run, as its metadata tell."""
    wanted, seen = [Requirement(line) for line in PROJECT["dependencies"]], set()
    while wanted:
        requirement = wanted.pop()
        name = canonicalize_name(requirement.name)
        if name in seen or (requirement.marker and not requirement.marker.evaluate({"extra": ""})):
            continue
        seen.add(name)
        told = metadata.metadata(name)
        licence = f"{told.get('License-Expression')} {' '.join(told.get_all('Classifier') or [])}"
        licence += f" {(told.get('License') or '').splitlines()[:1]}"
        assert not re.search(r"\bA?GPL|GNU (Affero )?General Public", licence), f"{name}: {licence}"
        wanted += [Requirement(line) for line in metadata.requires(name) or []]
    assert len(seen) > 20


REGISTRY = re.compile("index" + r"-url|find" + r"-links|pypi\.(org|python)|files\.python" + "hosted", re.IGNORECASE)
PLACE = re.compile(
    r"(?<![\w.~-])/(?:home|Users|root|work|workspace|tmp|var/tmp|scratch|mnt|media)/[\w.-]+|\b[A-Z]:\\+Users\b"
)
"""An absolute path to where somebody keeps or does things, which means nothing on another machine."""


def test_the_files_of_the_project_name_no_machine_and_no_registry() -> None:
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=REPOSITORY, capture_output=True, text=True, check=False)
    if listed.returncode:
        pytest.skip("not a git checkout")
    read = 0
    for name in listed.stdout.rstrip("\0").split("\0"):
        path = REPOSITORY / name
        content = path.read_bytes() if path.is_file() else b""  # one that is being removed is listed still
        if b"\0" not in content:
            read += 1
            for pattern in (REGISTRY, PLACE):
                found = pattern.search(content.decode(errors="replace"))
                assert not found, f"{name}: {found and found[0]}"
    assert read > 200


@pytest.mark.parametrize("folder", ["home", "Users", "root", "work", "tmp", "var/tmp", "mnt"])
def test_a_place_on_a_machine_is_known_when_it_is_seen(folder: str) -> None:
    for written in (f'"commit": "/{folder}/someone/data.ply"', f"see /{folder}/x", f"--out=/{folder}/run.1"):
        assert PLACE.search(written), written
    for written in (f"https://example.org/{folder}/x", f"~/{folder}/x", f"out/{folder}/x", f"/{folder}", "/dev/full"):
        assert not PLACE.search(written), written


def test_links_between_the_documents_lead_somewhere() -> None:
    for page in [REPOSITORY / "README.md", *(REPOSITORY / "docs").glob("*.md")]:
        for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", page.read_text()):
            if not target.startswith(("http://", "https://")):
                assert (page.parent / target).exists(), f"{page.name} → {target}"


def test_the_commands_of_the_readme_are_verbs() -> None:
    from naris.cli import VERBS

    used = re.findall(r"naris ([a-z]+)(?= )", "\n".join(re.findall(r"```.*?```|`[^`]+`", README, re.DOTALL)))
    assert len(used) >= 6
    assert set(used) <= set(VERBS)


def test_the_page_of_the_command_line_tells_every_verb_in_order() -> None:
    from naris.cli import VERBS

    page = (REPOSITORY / "docs" / "cli.md").read_text()
    assert re.findall(r"^## ([a-z][a-z -]+)$", page, re.MULTILINE) == list(VERBS)
