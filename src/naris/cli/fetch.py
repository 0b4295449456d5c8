"""Download public data, each file with its SHA-256 pinned; a broken download goes on where it stopped."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from naris.cli.console import Console
from naris.cli.options import IfGiven


@dataclass(frozen=True)
class Options:
    """What to download, and where to."""

    name: Annotated[tyro.conf.Positional[Literal["mean-nose"]], tyro.conf.arg(metavar="{mean-nose}")]
    """mean-nose: the mean nasal cavity of Sinha et al. 2018 and the texture of their experiment (1.8 MB, MIT)."""
    out: Annotated[IfGiven[Path], tyro.conf.arg(aliases=["-o"], metavar="DIR")] = None
    """Folder for the files; by default one of that name in the cache, $XDG_CACHE_HOME/naris or ~/.cache/naris."""
    base_url: Annotated[IfGiven[str], tyro.conf.arg(metavar="URL")] = None
    """Where the files lie, for a mirror; by default where they were published."""
    attempts: int = 4
    """How often a file is tried before giving up."""
    timeout_s: float = 30.0
    """How long a server may be silent, in seconds."""


def run(options: Options, console: Console) -> int:
    """Downloads what is missing and names the files."""
    from naris.fetch import COLLECTIONS, FetchConfig, fetch

    collection = COLLECTIONS[options.name]
    config = FetchConfig(base_url=options.base_url, attempts=options.attempts, timeout_s=options.timeout_s)
    paths = fetch(collection, options.out, config, console.progress)
    data = {
        "collection": collection.name,
        "licence": collection.licence,
        "folder": paths[0].parent,
        "files": [{"path": path, "sha256": file.sha256} for path, file in zip(paths, collection.files, strict=True)],
    }
    text = "\n".join([f"{collection.title} ({collection.licence})", *(f"  {path}" for path in paths)])
    console.answer(data, text)
    return 0


def interrupted(options: Options) -> str:
    """What a user who stopped it should know."""
    return "what came so far is kept; the same command goes on from there"
