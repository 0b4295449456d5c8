"""Which program made a reconstruction, by what lies in its folder."""

from __future__ import annotations

from pathlib import Path

from naris.errors import InputError
from naris.register.sfm.colmap import is_colmap, read_colmap
from naris.register.sfm.published import is_published, read_published
from naris.register.sfm.reconstruction import Reconstruction


def read_reconstruction(folder: Path) -> Reconstruction:
    """A sparse model of COLMAP, or a folder in the published format of endoscopy.

    Raises:
        InputError: if it is neither, both, or cannot be read.
    """
    colmap, published = is_colmap(folder), is_published(folder)
    if colmap == published:
        raise InputError(
            f"cameras, images and points3D of COLMAP in {folder.name}, or motion.yaml and structure.ply",
            "both" if colmap else "neither",
            "give the folder that the files lie in, such as sparse/0",
        )
    return read_colmap(folder) if colmap else read_published(folder)
