"""Virtual patients around one anatomy: smooth deformations of it, drawn from a Gaussian process.

As in M. Lüthi et al., "Gaussian process morphable models" (IEEE Transactions on Pattern Analysis and Machine
Intelligence 2018): a displacement is a Gaussian process over space whose kernel says how far points move and how far
around they move alike (their section 3.1), made symmetric by adding its mirror image (section 3.2), and computed with
few numbers by Nyström's method (section 3.3). A displacement that is too steep for one step is walked in several, as a
flow whose velocity stays where it is (V. Arsigny et al., MICCAI 2006), so that space never folds. To it comes the nasal
cycle (`naris.anatomy.nasal_cycle`). Vertices move, no face comes to cross another, and all that is known in the anatomy
moves with them (`naris.anatomy.carry`).
"""

from __future__ import annotations

import logging
from collections import Counter
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

from naris.anatomy.carry import carried_along
from naris.anatomy.crossings import crossings, uncrossed
from naris.anatomy.drawn import CLOSED, CROSSING, Drawn, reasons
from naris.anatomy.nasal_cycle import NasalCycle
from naris.anatomy.shape_curves import MOST_SD
from naris.core.anatomy import Anatomy, Between
from naris.errors import InputError, PoseError

log = logging.getLogger(__name__)

_SPREAD = 0.6  # scales between the points that the process is computed at
_KEPT = 1e-3  # modes with less than this share of the greatest are left out
_MOST_POINTS = 1500
_TRIES, _TOLD_EVERY = 20, 5  # draws
_STEEPEST = 0.5
"""The greatest stretch of a step: below 1 it cannot fold, and it is known at the points of the process only."""

_STEP_MM = 0.1
_CHUNK = 8192


@dataclass(frozen=True)
class Deformation:
    """How far virtual patients differ from the anatomy that they are made of.

    Attributes:
        amplitude_mm: standard deviation of a point's displacement along each axis; along x less near the middle, the
            less asymmetry the less.
        scale_mm: how far apart two points are whose displacements agree by 0.6 (exp(−½)).
        asymmetry: from 0, where both sides move as mirror images, to 1, where they know nothing of each other. An
            anatomy without landmarks of both sides has none to mirror: there it counts as 1.
        cycle_mm: standard deviation of the nasal cycle: how far the mucosa of one side swells and the other's shrinks.
            There is none without landmarks of both sides (`GaussianProcess.has_sides`).

    Raises:
        InputError: if a length is negative or not finite, the scale is 0, or the asymmetry is no share.
    """

    amplitude_mm: float = 0.8
    scale_mm: float = 12.0
    asymmetry: float = 0.3
    cycle_mm: float = 0.4

    def __post_init__(self) -> None:
        lengths = (self.amplitude_mm, self.scale_mm, self.cycle_mm)
        if not (np.isfinite(lengths).all() and min(lengths) >= 0 and self.scale_mm > 0 and 0 <= self.asymmetry <= 1):
            expected = "lengths of 0 mm or more, a scale above 0 and an asymmetry of 0–1"
            raise InputError(expected, f"{self}", "correct it")


@dataclass(frozen=True, eq=False)
class GaussianProcess:
    """A population around an anatomy; make one with `around`.

    Attributes:
        anatomy: that everybody is made of.
        deformation: how far they differ.
        points_mm: (M, 3) where the process is computed.
        modes: for the axis across (x), and for the other two: (M, K) weights of those points in each mode.
        basis: likewise (V, K): how vertices move, in units of 1 mm, at one standard deviation of each mode.
        cycle: the nasal cycle.
        crossings: pairs of faces of the anatomy itself that cross.
    """

    anatomy: Anatomy
    deformation: Deformation
    points_mm: Float[np.ndarray, "m 3"]
    modes: tuple[Float[np.ndarray, "m k"], Float[np.ndarray, "m l"]]
    basis: tuple[Float32[np.ndarray, "v k"], Float32[np.ndarray, "v l"]]
    cycle: NasalCycle
    crossings: int

    @property
    def has_sides(self) -> bool:
        """Whether landmarks tell the two sides, so that they can be mirrored and swell by turns."""
        return _middle_mm(self.anatomy) is not None and not isinstance(self.anatomy.airspace, Between)

    @staticmethod
    def around(anatomy: Anatomy, deformation: Deformation = Deformation()) -> GaussianProcess:
        """Find the modes (some seconds).

        Raises:
            InputError: if the scale is too fine for an anatomy of that size.
        """
        cell = np.round(anatomy.vertices_mm / (_SPREAD * deformation.scale_mm)).astype(np.int64)
        _, first = np.unique(cell, axis=0, return_index=True)
        if len(first) > _MOST_POINTS:
            raise InputError(
                f"a scale at which {_MOST_POINTS:,} points describe the anatomy",
                f"{deformation.scale_mm:g} mm, which takes {len(first):,}",
                "give a larger scale",
            )
        points, middle_mm = anatomy.vertices_mm[np.sort(first)], _middle_mm(anatomy)
        modes = tuple(_modes(kernel) for kernel in _kernels(points, points, deformation, middle_mm))
        basis = tuple(
            (kernel @ weights).astype(np.float32)
            for kernel, weights in zip(
                _kernels(anatomy.vertices_mm, points, deformation, middle_mm), modes, strict=True
            )
        )
        cycle = NasalCycle.of(anatomy, deformation.cycle_mm, middle_mm)
        own = len(crossings(anatomy.vertices_mm, anatomy.faces))
        return GaussianProcess(anatomy, deformation, points, modes, basis, cycle, own)  # type: ignore[arg-type]

    def patient(self, seed: int, number: int) -> Anatomy:
        """The anatomy of `draw`, without what was passed over."""
        return self.draw(seed, number).anatomy

    def draw(self, seed: int, number: int) -> Drawn:
        """The virtual patient number `number` of a population; it depends on the seed and its number alone.

        Coefficients are normal, none beyond 2.5. Where the nasal cycle would make faces cross it is taken back. A draw
        by which more faces cross than in the anatomy itself, or a passage leaves the lumen, is passed over; the source
        of the patient says which draw it is of.

        Raises:
            InputError: if twenty draws in a row are.
        """
        rng = np.random.default_rng([seed, number])
        d, sided, passed_over = self.deformation, self.has_sides, Counter({CROSSING: 0, CLOSED: 0})
        for draw in range(1, _TRIES + 1):
            if draw > 1 and draw % _TOLD_EVERY == 1:
                log.info("patient %d: %d of at most %d draws cross walls or close passages", number, draw - 1, _TRIES)
            drawn = [np.clip(rng.standard_normal((modes.shape[1], n)), -MOST_SD, MOST_SD)
                     for modes, n in zip(self.modes, (1, 2), strict=True)]  # fmt: skip
            cycle = float(np.clip(rng.standard_normal(), -MOST_SD, MOST_SD))
            deformed = self._deformed(drawn)
            vertices = uncrossed(deformed, deformed + self.cycle.shift_mm(cycle), self.anatomy.faces)
            if len(crossings(vertices, self.anatomy.faces)) > self.crossings:
                passed_over[CROSSING] += 1
                continue
            try:
                nose = carried_along(
                    self.anatomy,
                    vertices,
                    f"virtual patient {number} of seed {seed}, like {self.anatomy.name}",
                    f"{self.anatomy.name} under a Gaussian process of {d.amplitude_mm:g} mm over {d.scale_mm:g} mm"
                    + (
                        f", asymmetry {d.asymmetry:g}, nasal cycle {cycle * d.cycle_mm:+.2f} mm on the left"
                        if sided
                        else ""
                    )
                    + (f", draw {draw}" if draw > 1 else ""),
                )
            except PoseError:
                passed_over[CLOSED] += 1
                continue
            return Drawn(nose, dict(+passed_over))
        raise InputError(
            "deformations that leave passages open and walls apart",
            f"none in {_TRIES} draws ({reasons(passed_over)})",
            "deform it less",
        )

    def _deformed(self, drawn: list[Float[np.ndarray, "_k _n"]]) -> Float[np.ndarray, "v 3"]:
        """Where the vertices go: in one step by the displacement, or in as many as it is too steep for one."""
        shift = np.concatenate([basis @ of for basis, of in zip(self.basis, drawn, strict=True)], axis=1)
        steps = max(int(np.ceil(self._steepest(drawn) / _STEEPEST)), 1)
        at = self.anatomy.vertices_mm + shift / steps
        for _ in range(steps - 1):
            parts = np.array_split(at, -(-len(at) // _CHUNK))
            at = at + np.concatenate([self._displacement(part, drawn) for part in parts]) / steps
        return at

    def _steepest(self, drawn: list[Float[np.ndarray, "_k _n"]]) -> float:
        """How far apart two near points at the points of the process are moved, at most, in mm per mm between them."""
        if not self.deformation.amplitude_mm:
            return 0.0
        step = _STEP_MM / 2 * np.eye(3)
        columns = [
            (self._displacement(self.points_mm + way, drawn) - self._displacement(self.points_mm - way, drawn))
            / _STEP_MM
            for way in step
        ]
        return float(np.linalg.norm(np.stack(columns, axis=2), ord=2, axis=(1, 2)).max())

    def _displacement(
        self, at_mm: Float[np.ndarray, "n 3"], drawn: list[Float[np.ndarray, "_k _n"]]
    ) -> Float[np.ndarray, "n 3"]:
        """The displacement of any points."""
        kernels = _kernels(at_mm, self.points_mm, self.deformation, _middle_mm(self.anatomy))
        parts = [kernel @ (modes @ of) for kernel, modes, of in zip(kernels, self.modes, drawn, strict=True)]
        return np.concatenate(parts, axis=1)


def _middle_mm(anatomy: Anatomy) -> float | None:
    """The x of the plane between the two sides, None where their landmarks are not known."""
    marks = anatomy.landmarks_mm
    pairs = [(name, name.replace("left", "right")) for name in marks if name.startswith("left")]
    middles = [(marks[left][0] + marks[right][0]) / 2 for left, right in pairs if right in marks]
    return float(np.mean(middles)) if middles else None


def _kernels(
    at_mm: Float[np.ndarray, "n 3"],
    points_mm: Float[np.ndarray, "m 3"],
    deformation: Deformation,
    middle_mm: float | None,
) -> tuple[Float[np.ndarray, "n m"], Float[np.ndarray, "n m"]]:
    """The covariances of displacements at points, along x and across it.

    A squared exponential; of it, the share that is not asymmetry has its mirror image taken off (along x, where
    mirrored displacements turn) or added. What that does to the amplitude near the middle is divided out again, but
    along x, where mirrored displacements must vanish in the middle itself.
    """
    d = deformation
    plain = d.amplitude_mm**2 * _squared_exponential(at_mm, points_mm, d.scale_mm)
    if middle_mm is None or d.asymmetry == 1:
        return plain, plain
    mirrored = at_mm * [-1, 1, 1] + [2 * middle_mm, 0, 0]
    twin = (1 - d.asymmetry) * d.amplitude_mm**2 * _squared_exponential(mirrored, points_mm, d.scale_mm)
    one, other = (
        1 + (1 - d.asymmetry) * np.exp(-2 * ((points[:, 0] - middle_mm) / d.scale_mm) ** 2)
        for points in (at_mm, points_mm)
    )
    return plain - twin, (plain + twin) / np.sqrt(one[:, None] * other)


def _squared_exponential(
    one: Float[np.ndarray, "n 3"], other: Float[np.ndarray, "m 3"], scale_mm: float
) -> Float[np.ndarray, "n m"]:
    a, b = one / scale_mm, other / scale_mm
    square = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1) - 2 * a @ b.T
    return np.asarray(np.exp(-0.5 * np.maximum(square, 0.0)))


def _modes(covariance: Float[np.ndarray, "m m"]) -> Float[np.ndarray, "m k"]:
    """Weights of the points whose kernels add up to the modes: U Λ^−½, the greatest first."""
    values, vectors = np.linalg.eigh(covariance)
    values, vectors = values[::-1], vectors[:, ::-1]
    count = max(int((values > _KEPT * values[0]).sum()), 1) if values[0] > 0 else 0
    return np.asarray(vectors[:, :count] / np.sqrt(values[:count]))
