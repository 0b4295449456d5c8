"""Checks an installed naris from outside its repository: `installed.py BIN ELSEWHERE`, used by `.ci/run`.

BIN is the folder with the environment's programs, ELSEWHERE a folder to run them in.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from pathlib import Path

REPOSITORY = Path(__file__).resolve().parents[2]
IMPORT_ALL = """
import importlib, json, pkgutil, naris
names = [module.name for module in pkgutil.walk_packages(naris.__path__, "naris.")]
for name in names:
    importlib.import_module(name)
print(json.dumps({"where": naris.__file__, "modules": len(names), "version": naris.__version__}))
"""
LOAD_WEIGHTS = """
from naris.experiment.start_weights import START_WEIGHTS
from naris.model.checkpoint import load_checkpoint
load_checkpoint(START_WEIGHTS)
"""


def main() -> None:
    binaries, elsewhere = Path(sys.argv[1]), Path(sys.argv[2])
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

    def run(*words: str) -> str:
        command = [str(binaries / words[0]), *words[1:]]
        done = subprocess.run(command, cwd=elsewhere, env=environment, capture_output=True, text=True, check=False)
        if done.returncode:
            sys.exit(f"{' '.join(words[:3])} ended with {done.returncode}\n{done.stdout}{done.stderr}")
        return done.stdout

    listed = run("naris", "--help").partition("Verbs:")[2].partition("Options")[0]
    verbs = [re.split(r"  +", line.strip())[0] for line in listed.splitlines() if line.strip()]
    for verb in verbs:
        if f"naris {verb}" not in run("naris", *verb.split(), "--help"):
            sys.exit(f"naris {verb} --help does not tell its usage")
    found = json.loads(run("python", "-I", "-c", IMPORT_ALL))
    if Path(found["where"]).resolve().is_relative_to(REPOSITORY):
        sys.exit(f"the repository was used, not the wheel: {found['where']}")
    if run("naris", "--version").strip() != f"naris {found['version']}":
        sys.exit("naris --version is not the version of the package")
    if not (Path(found["where"]).parent / "py.typed").exists():
        sys.exit("the wheel lacks py.typed")
    run("python", "-I", "-c", LOAD_WEIGHTS)
    print(f"naris {found['version']} from the wheel: {len(verbs)} verbs answer, {found['modules']} modules import")


if __name__ == "__main__":
    main()
