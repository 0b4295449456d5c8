"""What structure from motion made of a video: points, and cameras that each saw some of them.

Its unit is its own. Nothing in the pictures tells how many mm it is, so whoever registers says what is known of it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from naris.core.camera import Intrinsics
from naris.core.pose import Pose
from naris.errors import InputError
from naris.register.noise import PointNoise, Scale, any_scale
from naris.register.observation import Observation, from_sightings

WORLD = "world"
"""The frame of the points, wherever the program put it."""
_MOST_BEHIND = 0.1
_FEWEST_MORE = 12
_MOST_POINTS = 1024
_NOISE = 0.03
_NAMED = 3


@dataclass(frozen=True, eq=False)
class View:
    """One picture of a reconstruction.

    Attributes:
        name: as the reconstruction has it.
        camera_T_world: where it was taken; its translation is in the unit of the reconstruction, not in mm.
        intrinsics: of the picture.
        seen: (K,) numbers of the points that it saw.
    """

    name: str
    camera_T_world: Pose
    intrinsics: Intrinsics
    seen: Int[np.ndarray, "k"]


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """Views, and points (N, 3) in the world, in the unit of the reconstruction."""

    views: tuple[View, ...]
    points: Float[np.ndarray, "n 3"]

    def view(self, name: str | None) -> View:
        """The view of that name.

        Raises:
            InputError: if there is none; the message has some names.
        """
        for view in self.views:
            if view.name == name:
                return view
        some = ", ".join(view.name for view in self.views[:_NAMED])
        more = f" and {len(self.views) - _NAMED} more" if len(self.views) > _NAMED else ""
        got = "none" if name is None else repr(name)
        raise InputError(f"a view of the reconstruction ({some}{more})", got, "name one of those")

    def seen_by(self, view: View) -> Float[np.ndarray, "k 3"]:
        """The points that a view saw, in its camera.

        Raises:
            InputError: if it saw none, or many of them lie behind it: poses and points do not belong together then.
        """
        if not len(view.seen):
            raise InputError(f"points that {view.name} saw", "none", "name another view")
        points = view.camera_T_world.apply(self.points[view.seen])
        behind = int((points[:, 2] <= 0).sum())
        if behind > _MOST_BEHIND * len(points):
            raise InputError(
                f"points in front of the camera of {view.name}",
                f"{behind} of {len(points)} behind it",
                "check that points and poses are of one reconstruction",
            )
        return points


def noise_of(points: Float[np.ndarray, "n 3"]) -> PointNoise:
    """Where nobody says how wrong the points are: 3 % of their median distance, and a tenth of them useless."""
    return PointNoise(_NOISE * float(np.median(np.linalg.norm(points, axis=1))))


def unknown_scale(points: Float[np.ndarray, "n 3"]) -> Scale:
    """Any factor that puts the median of these points, in a camera, 3 to 30 mm away."""
    return any_scale(float(np.median(np.linalg.norm(points, axis=1))))


def observed(
    reconstruction: Reconstruction, reference: View, noise: PointNoise, scale: Scale, *, alone: bool = False
) -> Observation:
    """The points of a reconstruction as one observation in the camera of a view.

    Each point lies on the ray of one camera that saw it: of the reference, or else of the view that adds most. Points
    that only views with less than a dozen new ones saw are left out, and of many points 1,024 are kept.

    Args:
        reconstruction: all of it.
        reference: the view whose camera is the rig.
        noise: of the points, in the unit of the reconstruction.
        scale: what is known of that unit.
        alone: only the points that the reference saw.

    Raises:
        InputError: if they are too few, on one line, or mostly behind a camera.
    """
    chosen = [(reference, reference.seen)] if alone else _shared_out(reconstruction, reference)
    points, cameras, seen_from = [], [], []
    for number, (view, seen) in enumerate(chosen):
        reconstruction.seen_by(view)
        reference_T_view = reference.camera_T_world @ view.camera_T_world.inverse()
        points.append(reference.camera_T_world.apply(reconstruction.points[seen]))
        cameras.append(reference_T_view.position_mm)
        seen_from.append(np.full(len(seen), number))
    return from_sightings(np.concatenate(points), np.stack(cameras), np.concatenate(seen_from), noise, scale).some(
        _MOST_POINTS
    )


def _shared_out(reconstruction: Reconstruction, reference: View) -> list[tuple[View, Int[np.ndarray, "k"]]]:
    """Each point once: those of the reference, then again and again those of the view that adds most."""
    left = np.ones(len(reconstruction.points), dtype=bool)
    left[reference.seen] = False
    chosen = [(reference, reference.seen)]
    while True:
        most = max(reconstruction.views, key=lambda view: int(left[view.seen].sum()))
        new = most.seen[left[most.seen]]
        if len(new) < _FEWEST_MORE:
            return chosen
        left[new] = False
        chosen.append((most, new))
