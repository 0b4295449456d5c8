"""What a benchmark measures on: the published mean nose where it is, else the built-in nose, and it says which."""

from __future__ import annotations

import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from naris.anatomy.folder import BUILTIN, load_anatomy
from naris.bench import BenchRequest
from naris.core.anatomy import Anatomy
from naris.core.provenance import file_digest
from naris.fetch import MEAN_NOSE, cache_folder
from naris.render.appearance import PAPER, Appearance
from naris.render.material import TextureColours

LOG = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Subject:
    """An anatomy with the published light.

    Attributes:
        anatomy: with regions and passages.
        appearance: the published light, and the texture if there is one.
        texture: the picture of the walls, None without one.
        inputs: role → name and digest, for the record.
    """

    anatomy: Anatomy
    appearance: Appearance
    texture: Path | None
    inputs: Mapping[str, str]


def subject(request: BenchRequest) -> Subject:
    """What was asked for; by default the mean nose with its texture as `naris fetch mean-nose` left them.

    Without them the built-in nose takes their place, with a warning: its figures are not those that documents quote.

    Raises:
        SurfaceError: if the anatomy cannot be read.
        ImageError: if the texture cannot.
    """
    folder = cache_folder() / MEAN_NOSE.name
    mesh, picture = (folder / file.name for file in MEAN_NOSE.files[:2])
    what, texture = request.anatomy, request.texture
    if what is None and mesh.is_file():
        what, texture = str(mesh), texture or (picture if picture.is_file() else None)
    if what is None:
        LOG.warning("the mean nose is not here (naris fetch mean-nose): measuring on the built-in nose instead")
        what = BUILTIN
    anatomy = load_anatomy(what)
    inputs = {"anatomy": f"{anatomy.name}, digest {anatomy.digest}"}
    if texture is None:
        return Subject(anatomy, PAPER, None, inputs)
    inputs["texture"] = f"{texture.name}, SHA-256 {file_digest(Path(texture))}"
    return Subject(anatomy, PAPER.with_(material=TextureColours.read(texture)), texture, inputs)
