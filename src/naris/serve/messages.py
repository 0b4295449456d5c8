"""What the page sends to the viewer, as it is checked: nothing more, and within its limits."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from naris.core.camera import Brown, Intrinsics, Pinhole

_MOST_PX = 2048
_MOST_DABS = 2000


class LensTold(BaseModel):
    """What the page looks through: a vertical field of view, lens and all, and how the lens bends."""

    model_config = ConfigDict(extra="forbid")
    fov_deg: float = Field(45.0, ge=5, le=140)
    k1: float = Field(0.0, ge=-40, le=0)

    def camera(self, width: int, height: int) -> Intrinsics:
        """One with this lens."""
        lens = Brown(self.k1) if self.k1 else Pinhole()
        return Intrinsics.from_vertical_fov(width, height, self.fov_deg, lens)


class FrameAsked(LensTold):
    """A picture by our own renderer."""

    pose: list[list[float]]
    width: int = Field(300, ge=16, le=_MOST_PX)
    height: int = Field(300, ge=16, le=_MOST_PX)
    steady: bool = True


class SlicesAsked(BaseModel):
    """Three slices through a place."""

    model_config = ConfigDict(extra="forbid")
    place: tuple[float, float, float]
    span_mm: float = Field(80.0, ge=5, le=400)
    size: int = Field(240, ge=32, le=800)
    level: float = Field(0.0, ge=-2000, le=5000)
    width: float = Field(2500.0, ge=1, le=10_000)


class StrokeTold(BaseModel):
    """A stroke of the brush: a region, by its number, around places (mm)."""

    model_config = ConfigDict(extra="forbid")
    region: int
    radius_mm: float = Field(3.0, gt=0.2, le=20)
    points: list[tuple[float, float, float]] = Field(max_length=_MOST_DABS)


class UndoTold(BaseModel):
    """How many strokes the page knows of: the last of these is taken back."""

    model_config = ConfigDict(extra="forbid")
    strokes: int


class PoseTold(BaseModel):
    """Where the scope is."""

    model_config = ConfigDict(extra="forbid")
    pose: list[list[float]]


class KeyframeTold(BaseModel):
    """A keyframe of the page."""

    model_config = ConfigDict(extra="forbid")
    name: str
    pose: list[list[float]]


class KeyframesTold(BaseModel):
    """All keyframes of the page, in their order."""

    model_config = ConfigDict(extra="forbid")
    place: str
    revision: str
    keyframes: list[KeyframeTold]


class SimulationAsked(LensTold):
    """Pictures along the keyframes."""

    per_position: int = Field(10, ge=1, le=1000)
    step_mm: float = Field(1.0, gt=0.01, le=100)
