"""The appearances that have a name on the command line."""

from __future__ import annotations

from pathlib import Path

from naris.errors import InputError
from naris.render.appearance import (
    ENDOSCOPE,
    PAPER,
    PAPER_CULLED,
    TRAINING_APPEARANCE,
    UNSEEN_APPEARANCE,
    Appearance,
    AppearanceDistribution,
)
from naris.render.material import TextureColours

_ONE_LOOK = {"endoscope": ENDOSCOPE, "paper": PAPER, "paper-culled": PAPER_CULLED}
_MANY_LOOKS = {"training": TRAINING_APPEARANCE, "unseen": UNSEEN_APPEARANCE}


def look(name: str, texture: Path | None = None) -> Appearance | AppearanceDistribution:
    """The appearance of that name, its walls coloured by a picture if one is given.

    Raises:
        InputError: if there is none of that name, or a texture does not go with it.
        ImageError: if the texture is no picture.
    """
    known: dict[str, Appearance | AppearanceDistribution] = {**_ONE_LOOK, **_MANY_LOOKS}
    if name not in known:
        raise InputError(f"one of the appearances {sorted(known)}", repr(name), "name one of those")
    if texture is None:
        return known[name]
    if name not in _ONE_LOOK:
        raise InputError(
            "--texture with one look for all pictures", f"--appearance {name}", "use --appearance paper or endoscope"
        )
    return _ONE_LOOK[name].with_(material=TextureColours.read(texture))
