"""Which engine a scene gets."""

from __future__ import annotations

from naris.core.anatomy import Anatomy
from naris.errors import InputError
from naris.render.scene import Engine, EngineName

ENGINES: tuple[EngineName, ...] = ("auto", "fast", "numpy")


def start_engine(anatomy: Anatomy, name: EngineName) -> Engine:
    """The engine of that name for an anatomy.

    Raises:
        InputError: if there is no engine of that name.
        EngineUnavailable: if it cannot start here.
    """
    from naris.render.reference import NumpyEngine

    if name not in ENGINES:
        raise InputError(f"one of the engines {ENGINES}", repr(name), "name one of those")
    return NumpyEngine(anatomy)
