"""Virtual patients around one anatomy: smooth deformations of it, drawn from a Gaussian process.

As in M. Lüthi et al., "Gaussian process morphable models" (IEEE Transactions on Pattern Analysis and Machine
Intelligence 2018): a displacement is a Gaussian process over space whose kernel says how far points move and how far
around they move alike (their section 3.1), made symmetric by adding its mirror image (section 3.2), and computed with
few numbers by Nyström's method (section 3.3). To it comes the **nasal cycle**: the mucosa of one side swells while that
of the other shrinks. Vertices move, and all that is known in the anatomy moves with them (`naris.anatomy.carry`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32
from scipy.sparse import coo_array, csr_array

from naris.anatomy.carry import carried_along
from naris.anatomy.distance import signed_distance
from naris.core.anatomy import Anatomy, Between
from naris.errors import InputError, PoseError

_SPREAD = 0.6  # scales between the points that the process is computed at
_KEPT = 1e-3  # modes with less than this share of the greatest are left out
_MOST_POINTS = 1500
_MOST_SD = 2.5
_TRIES = 20
_FOLD = 0.1  # least volume that a small cube may be left with
_STEP_MM = 0.1
_CYCLE_MARCH_MM = np.arange(0.25, 4.01, 0.25)
_CYCLE_MOST = 0.4  # of the half-width of the air before a wall, or of the tissue behind it
_CYCLE_SIDE_MM = 0.7  # beside the middle, where one side's mucosa becomes the other's
_CYCLE_ENDS_MM = 5.0  # over which it fades at nostrils and choanae
_SMOOTHINGS = 8


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
        swelling_mm: (V,) how far each vertex moves into the lumen along its normal at one standard deviation of the
            nasal cycle; the other way on the other side.
        most_in_mm, most_out_mm: (V,) how far a vertex may move into the lumen or out of it, so that no slit closes and
            no wall is worn through.
    """

    anatomy: Anatomy
    deformation: Deformation
    points_mm: Float[np.ndarray, "m 3"]
    modes: tuple[Float[np.ndarray, "m k"], Float[np.ndarray, "m l"]]
    basis: tuple[Float32[np.ndarray, "v k"], Float32[np.ndarray, "v l"]]
    swelling_mm: Float[np.ndarray, "v"]
    most_in_mm: Float[np.ndarray, "v"]
    most_out_mm: Float[np.ndarray, "v"]

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
        modes = tuple(_modes(_kernel(points, points, deformation, middle_mm, sign)) for sign in (-1, 1))
        basis = tuple(
            (_kernel(anatomy.vertices_mm, points, deformation, middle_mm, sign) @ weights).astype(np.float32)
            for sign, weights in zip((-1, 1), modes, strict=True)
        )
        swelling, most_in, most_out = _cycle(anatomy, deformation, middle_mm)
        return GaussianProcess(anatomy, deformation, points, modes, basis, swelling, most_in, most_out)  # type: ignore[arg-type]

    def patient(self, seed: int, number: int) -> Anatomy:
        """The virtual patient number `number` of a population; it depends on the seed and its number alone.

        Coefficients are normal, none beyond 2.5. A draw under which space would fold, or a passage would leave the
        lumen, is passed over.

        Raises:
            InputError: if twenty draws in a row are.
        """
        rng = np.random.default_rng([seed, number])
        d, sided = self.deformation, self.has_sides
        for _ in range(_TRIES):
            drawn = [np.clip(rng.standard_normal((modes.shape[1], n)), -_MOST_SD, _MOST_SD)
                     for modes, n in zip(self.modes, (1, 2), strict=True)]  # fmt: skip
            cycle = float(np.clip(rng.standard_normal(), -_MOST_SD, _MOST_SD))
            if self._least_volume(drawn) < _FOLD:
                continue
            shift = np.concatenate([basis @ of for basis, of in zip(self.basis, drawn, strict=True)], axis=1)
            swollen = np.clip(cycle * self.swelling_mm, -self.most_out_mm, self.most_in_mm)
            vertices = self.anatomy.vertices_mm - swollen[:, None] * self.anatomy.vertex_normals + shift
            try:
                return carried_along(
                    self.anatomy,
                    vertices,
                    f"virtual patient {number} of seed {seed}",
                    f"{self.anatomy.name} under a Gaussian process of {d.amplitude_mm:g} mm over {d.scale_mm:g} mm"
                    + (
                        f", asymmetry {d.asymmetry:g}, nasal cycle {cycle * d.cycle_mm:+.2f} mm on the left"
                        if sided
                        else ""
                    ),
                )
            except PoseError:
                continue
        raise InputError("deformations that leave the passages open", f"none in {_TRIES} draws", "deform it less")

    def _least_volume(self, drawn: list[Float[np.ndarray, "_k _n"]]) -> float:
        """The least share of its volume that space keeps, at the points of the process: below 0 it folds."""
        middle_mm, columns = _middle_mm(self.anatomy), []
        for axis in np.eye(3):
            moved = []
            for way in (-1, 1):
                at = self.points_mm + way * _STEP_MM / 2 * axis
                moved.append(
                    np.concatenate(
                        [
                            _kernel(at, self.points_mm, self.deformation, middle_mm, sign) @ (modes @ of)
                            for sign, modes, of in zip((-1, 1), self.modes, drawn, strict=True)
                        ],
                        axis=1,
                    )
                )
            columns.append((moved[1] - moved[0]) / _STEP_MM + axis)
        return float(np.linalg.det(np.stack(columns, axis=2)).min())


def _middle_mm(anatomy: Anatomy) -> float | None:
    """The x of the plane between the two sides, None where their landmarks are not known."""
    marks = anatomy.landmarks_mm
    pairs = [(name, name.replace("left", "right")) for name in marks if name.startswith("left")]
    middles = [(marks[left][0] + marks[right][0]) / 2 for left, right in pairs if right in marks]
    return float(np.mean(middles)) if middles else None


def _kernel(
    at_mm: Float[np.ndarray, "n 3"],
    points_mm: Float[np.ndarray, "m 3"],
    deformation: Deformation,
    middle_mm: float | None,
    sign: int,
) -> Float[np.ndarray, "n m"]:
    """The covariance of displacements at points, along x (`sign` −1: mirrored it turns) or across it (1).

    A squared exponential; of it, the share that is not asymmetry has its mirror image added or taken off. What that
    does to the amplitude near the middle is divided out again, but along x, where mirrored displacements must vanish in
    the middle itself.
    """
    d = deformation
    plain = _squared_exponential(at_mm, points_mm, d.scale_mm)
    if middle_mm is not None and d.asymmetry < 1:
        mirrored = at_mm * [-1, 1, 1] + [2 * middle_mm, 0, 0]
        plain += sign * (1 - d.asymmetry) * _squared_exponential(mirrored, points_mm, d.scale_mm)
        if sign > 0:
            one, other = (
                1 + (1 - d.asymmetry) * np.exp(-2 * ((points[:, 0] - middle_mm) / d.scale_mm) ** 2)
                for points in (at_mm, points_mm)
            )
            plain /= np.sqrt(one[:, None] * other)
    return d.amplitude_mm**2 * plain


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


def _cycle(
    anatomy: Anatomy, deformation: Deformation, middle_mm: float | None
) -> tuple[Float[np.ndarray, "v"], Float[np.ndarray, "v"], Float[np.ndarray, "v"]]:
    """How far vertices swell into the lumen at one standard deviation, and how far they may move in and out."""
    count = len(anatomy.vertices_mm)
    marks = anatomy.landmarks_mm
    ends = [f"{side}.{name}" for side in ("left", "right") for name in ("nostril", "choana")]
    known = middle_mm is not None and all(name in marks for name in ends)
    if middle_mm is None or not known or deformation.cycle_mm == 0 or isinstance(anatomy.airspace, Between):
        return np.zeros(count), np.zeros(count), np.zeros(count)
    distance, normals = signed_distance(anatomy), anatomy.vertex_normals
    march = _CYCLE_MARCH_MM[:, None, None]
    air = distance(anatomy.vertices_mm - march * normals).max(axis=0)
    tissue = -distance(anatomy.vertices_mm + march * normals).min(axis=0)
    x, y = anatomy.vertices_mm[:, 0] - middle_mm, anatomy.vertices_mm[:, 1]
    front = max(float(marks[f"{side}.nostril"][1]) for side in ("left", "right"))
    behind = min(float(marks[f"{side}.choana"][1]) for side in ("left", "right"))
    within = np.clip(np.minimum(y - front, behind - y) / _CYCLE_ENDS_MM, 0, 1)
    smooth = _smoothing(anatomy)
    swelling = deformation.cycle_mm * within * np.tanh(x / _CYCLE_SIDE_MM)
    most_in, most_out = _CYCLE_MOST * np.maximum(air, 0), _CYCLE_MOST * np.maximum(tissue, 0)
    for _ in range(_SMOOTHINGS):
        swelling, most_in, most_out = (smooth @ field for field in (swelling, most_in, most_out))
    return swelling, most_in, most_out


def _smoothing(anatomy: Anatomy) -> csr_array:
    """The matrix that takes a field on the vertices to its mean over each vertex and its neighbours."""
    count = len(anatomy.vertices_mm)
    edges = np.concatenate([anatomy.faces[:, [a, b]] for a, b in ((0, 1), (1, 2), (2, 0))])
    pairs = np.unique(np.concatenate([edges, edges[:, ::-1], np.repeat(np.arange(count)[:, None], 2, axis=1)]), axis=0)
    share = 1 / np.bincount(pairs[:, 0], minlength=count)
    return coo_array((share[pairs[:, 0]], (pairs[:, 0], pairs[:, 1])), shape=(count, count)).tocsr()
