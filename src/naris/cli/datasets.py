"""Which pictures with poses a command line means: a data set of naris, or the original's `frame/` and `pose/`."""

from __future__ import annotations

from pathlib import Path

from naris.anatomy.regions import PAPER_SLABS, read_regions
from naris.core.anatomy import RegionSet
from naris.dataset.layout import ABOUT
from naris.dataset.original import FRAMES, POSES, read_original
from naris.dataset.read import Dataset
from naris.errors import InputError


def is_dataset(folder: Path) -> bool:
    """Whether a path is a data set of either kind, by its names and without reading it."""
    return (folder / ABOUT).is_file() or is_original(folder)


def is_original(folder: Path) -> bool:
    """Whether a folder is one of the published code; one of the two folders in it is enough to mean that."""
    return not (folder / ABOUT).is_file() and ((folder / FRAMES).is_dir() or (folder / POSES).is_dir())


def open_dataset(folder: Path, regions: RegionSet | None) -> Dataset:
    """Read it.

    Args:
        folder: of either kind.
        regions: that label the original's poses, which come without any; a data set of naris has its own.

    Raises:
        DatasetError: if it is none, or is incomplete or inconsistent.
        InputError: if it is the original's and there are no regions.
    """
    if not is_original(folder):
        return Dataset.open(folder)
    if regions is None:
        raise InputError(
            f"regions for the poses in {folder}, which the original's folders do not tell",
            "none",
            f"give --regions {PAPER_SLABS.name} for the published slabs, or a JSON file",
        )
    return read_original(folder, regions)


def named_regions(what: str | None) -> RegionSet | None:
    """The region set that a word means where no anatomy is at hand: the published slabs by their name, or a JSON file.

    Raises:
        RegionError: if it is neither.
    """
    if what is None or what == PAPER_SLABS.name:
        return None if what is None else PAPER_SLABS
    return read_regions(what)
