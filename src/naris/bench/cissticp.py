"""Clouds to a surface: the reference runs of cisstICP, on a shape made of two middle turbinates.

In each run 300 points of the surface were given an error of 1 mm in every direction and, where the method looks at
normals, these one of 2°; the offset took them 17 mm and 10° away. The truth is the identity, and the error is the mean
over the vertices. The noise is what the runs were told: their covariances, and of the normals 2° with the eccentricity
0.5 along the axes in the files (the clouds that the peer gave to IMLOP and P-IMLOP have it too).

There are only four clouds, two of them the same. So beside each error stand that of the most likely matches alone, that
from the truth as the start, and that of the 300 pairs if they were known, below which it takes luck to fall; and the
mean errors in clouds drawn from the same shape, with the same noise.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from naris.anatomy.mesh_files import MeshFile
from naris.anatomy.ply import read_ply
from naris.bench import BenchRequest
from naris.bench.result import Figure, Peer
from naris.core.pose import Pose
from naris.errors import InputError
from naris.register.libraries import LIBRARIES, aligner, target_of
from naris.register.likely_point.noise import CloudNoise
from naris.register.likely_point.points import Method, register_points
from naris.register.likely_point.solve import PointsConfig
from naris.register.likely_point.surface import Surface, surface_from

FOLDER, MESH = "cissticp", "cissticp/MT.ply"
FRAME, CLOUD = "turbinates", "cloud"
GOALS_MM = {"imlp": 0.30, "imlop": 0.136}
WORST_GOAL_MM = 0.30
_CISSTICP = "cisstICP"
_NORMALS_DEG, _ECCENTRICITY = 2.0, 0.5
_TARGET_POINTS = 50_000
_PEER_REACHES_MM = (20.0, 10.0, 5.0)
_WHOLE, _MATCHES = PointsConfig(average=True), PointsConfig()
_DRAWN, _POINTS, _AWAY_MM, _AWAY_RAD = 8, 300, 7.0, 0.1


class Case(NamedTuple):
    """A run: its name here, its folder, and the files of the cloud, the truth, covariances and axes of the normals."""

    name: str
    folder: str
    noisy: str
    true: str
    covariances: str
    axes: str | None = None

    @property
    def method(self) -> Method:
        return "imlp" if self.axes is None else "imlop"


CASES = (
    Case("imlp", "LastRun_IMLP", "SaveNoisySamples.pts", "SaveSamples.pts", "SaveSampleCov.txt"),
    Case("imlop", "LastRun_IMLOP", "SaveNoisySamples", "SaveSamples", "SaveCov.pts", "SaveL.pts"),
    Case("pimlop", "LastRun_PIMLOP", "SaveNoisySamples", "SaveSamples", "SaveCov.pts", "SaveL.pts"),
    Case("gimlop", "LastRun_GIMLOP", "SaveEccNoisySamples", "SaveSamples", "SaveCov.pts", "SaveEccL.pts"),
)


@dataclass(frozen=True, eq=False)
class Run:
    """What a run was given, in mm, and where the peer ended.

    Attributes:
        points, normals: (N, 3) with errors.
        true_points, true_normals: (N, 3) without.
        noise: as the run was told.
        start, reached: from the cloud to the surface.
    """

    points: Float[np.ndarray, "n 3"]
    normals: Float[np.ndarray, "n 3"]
    true_points: Float[np.ndarray, "n 3"]
    true_normals: Float[np.ndarray, "n 3"]
    noise: CloudNoise
    start: Pose
    reached: Pose


def figures(request: BenchRequest) -> list[Figure]:
    """Errors of all runs; without values where the data is not given."""
    if request.scans is None or not (request.scans / MESH).is_file():
        return [Figure(f"register.cissticp.{name}_mm", None, "mm", 0, "lower", goal) for name, goal in _goals()]
    mesh = read_ply(request.scans / MESH, (request.scans / MESH).read_bytes())
    surface = surface_from(mesh.vertices, mesh.faces, FRAME)
    runs = {case: read_run(request.scans / FOLDER, case) for case in CASES}
    peers = _of_peers(mesh, list(runs.values()), request.seed)
    for case in CASES[:2]:  # compiles what there is to compile, so that no run pays for it
        error_mm(mesh, surface, case.method, runs[case], _WHOLE)
    done: list[Figure] = []
    with request.progress.task("cisstICP's runs", len(CASES)) as advance:
        for number, (case, run) in enumerate(runs.items()):
            done += _of_run(mesh, surface, case, run, {name: values[number] for name, values in peers.items()})
            advance(1)
    return [*done, _worst(done), *_of_drawn(request, mesh, surface)]


def _goals() -> list[tuple[str, float | None]]:
    return [*((case.name, GOALS_MM.get(case.name)) for case in CASES), ("worst", WORST_GOAL_MM)]


def error_mm(mesh: MeshFile, surface: Surface, method: Method, run: Run, config: PointsConfig) -> float:
    """Of a run from its start."""
    found = register_points(
        run.points, surface, run.start, run.noise, normals=run.normals, method=method, config=config
    )
    return mean_off_mm(mesh, found.surface_T_points)


def _of_run(mesh: MeshFile, surface: Surface, case: Case, run: Run, peers: dict[str, Peer]) -> list[Figure]:
    base = f"register.cissticp.{case.name}"
    begun = time.process_time()
    whole_mm = error_mm(mesh, surface, case.method, run, _WHOLE)
    spent = time.process_time() - begun
    from_truth = replace(run, start=Pose.identity(FRAME, CLOUD))
    rest = {
        "matches": error_mm(mesh, surface, case.method, run, _MATCHES),
        "from_truth": error_mm(mesh, surface, case.method, from_truth, _WHOLE),
        "paired": mean_off_mm(mesh, _of_pairs(case, run)),
    }
    return [
        Figure(f"{base}_mm", whole_mm, "mm", 1, "lower", GOALS_MM.get(case.name), peers=peers),
        *(Figure(f"{base}.{name}_mm", value, "mm", 1, "lower") for name, value in rest.items()),
        Figure(f"{base}.cpu_s", spent, "CPU-s", 1, "lower"),
    ]


def _of_drawn(request: BenchRequest, mesh: MeshFile, surface: Surface) -> list[Figure]:
    """Mean errors in clouds drawn here, over all of the surface; one if it is to be quick."""
    count = 1 if request.quick else _DRAWN
    runs = [_drawn_run(mesh, np.random.default_rng([request.seed, 8, number])) for number in range(count)]
    done: list[Figure] = []
    with request.progress.task("drawn clouds", 4 * count) as advance:
        methods: tuple[Method, ...] = ("imlp", "imlop")
        for method in methods:
            for name, config in ((f"{method}_mm", _WHOLE), (f"{method}.matches_mm", _MATCHES)):
                errors = []
                for run in runs:
                    errors.append(error_mm(mesh, surface, method, run, config))
                    advance(1)
                done.append(Figure(f"register.cissticp.drawn.{name}", float(np.mean(errors)), "mm", count, "lower"))
    return done


def _drawn_run(mesh: MeshFile, rng: np.random.Generator) -> Run:
    there = target_of(mesh.vertices, mesh.faces, _POINTS, rng)
    turned = there.normals + np.deg2rad(_NORMALS_DEG) * rng.standard_normal((_POINTS, 3))
    start = np.concatenate([_AWAY_MM * rng.standard_normal(3), _AWAY_RAD * rng.standard_normal(3)])
    return Run(
        points=there.points + rng.standard_normal((_POINTS, 3)),
        normals=turned / np.linalg.norm(turned, axis=1, keepdims=True),
        true_points=there.points,
        true_normals=there.normals,
        noise=CloudNoise.even(1.0, float(np.deg2rad(_NORMALS_DEG))),
        start=Pose.exp(start, FRAME, CLOUD),
        reached=Pose.identity(FRAME, CLOUD),
    )


def _worst(done: Sequence[Figure]) -> Figure:
    """Of all runs, and of each peer in its worst."""
    runs = [figure for case in CASES for figure in done if figure.name == f"register.cissticp.{case.name}_mm"]
    peers: dict[str, Peer] = {}
    for name in runs[0].peers:
        values = [figure.peers[name] for figure in runs]
        said = [value for value in values if isinstance(value, str)]
        peers[name] = said[0] if said else max(value for value in values if isinstance(value, float))
    worst = max(figure.value for figure in runs if figure.value is not None)
    return Figure("register.cissticp.worst_mm", worst, "mm", len(runs), "lower", WORST_GOAL_MM, peers=peers)


def _of_peers(mesh: MeshFile, runs: Sequence[Run], seed: int) -> dict[str, list[Peer]]:
    """What each came to in each run: cisstICP as it left it, the others from points alone."""
    errors: dict[str, list[Peer]] = {_CISSTICP: [mean_off_mm(mesh, run.reached) for run in runs]}
    target = target_of(mesh.vertices, mesh.faces, _TARGET_POINTS, np.random.default_rng(seed))
    for name in LIBRARIES:
        ready = aligner(name, target, _PEER_REACHES_MM)
        if isinstance(ready, str):
            errors[name] = [ready] * len(runs)
            continue
        ended = [ready(run.points)(run.start.matrix) for run in runs]
        errors[name] = [mean_off_mm(mesh, Pose(pose, FRAME, CLOUD)) for pose in ended]
    return errors


def mean_off_mm(mesh: MeshFile, surface_T_points: Pose) -> float:
    """The mean over the vertices of how far a pose takes them from where they are."""
    return float(np.linalg.norm(surface_T_points.apply(mesh.vertices) - mesh.vertices, axis=1).mean())


def _of_pairs(case: Case, run: Run) -> Pose:
    """The pose that fits the points best if it is known which place each is of (Arun et al. 1987), with normals."""
    here, there = run.points.mean(axis=0), run.true_points.mean(axis=0)
    product = (run.points - here).T @ (run.true_points - there)
    if case.axes is not None:
        product += np.mean(run.noise.concentration) * run.normals.T @ run.true_normals
    u, _, w = np.linalg.svd(product)
    rotation = w.T @ np.diag([1, 1, np.linalg.det(u @ w)]) @ u.T
    return Pose.of(rotation, there - rotation @ here, FRAME, CLOUD)


def read_run(folder: Path, case: Case) -> Run:
    """A run of the data.

    Raises:
        InputError: if a file is missing or holds something else.
    """
    at = folder / case.folder
    (points, normals), (true_points, true_normals) = (_read_cloud(at / name) for name in (case.noisy, case.true))
    covariances = _read_numbers(at / case.covariances, 9).reshape(-1, 3, 3)
    covariances = 0.5 * (covariances + np.swapaxes(covariances, 1, 2))
    if case.axes is None:
        noise = CloudNoise(covariances)
    else:
        major = _read_numbers(at / case.axes, 6)[:, :3]
        major /= np.linalg.norm(major, axis=1, keepdims=True)
        noise = CloudNoise(covariances, np.deg2rad(_NORMALS_DEG) ** -2, _ECCENTRICITY, major)
    start, reached = (_read_pose(at / name) for name in ("SaveOffsetXfm.txt", "SaveRegXfm.txt"))
    return Run(points, normals, true_points, true_normals, noise, start, reached)


def _read_cloud(path: Path) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
    words = _words(path)
    count = int(words[1]) if len(words) > 1 and words[1].isdigit() else -1
    if len(words) != 2 * (2 + 3 * count) or words[2 + 3 * count] != "POINT_ORIENTATIONS":
        raise InputError(
            f"points and their normals in {path.name}", f"{len(words)} words", "take the file as published"
        )
    points, normals = (
        np.array(words[first : first + 3 * count], dtype=np.float64).reshape(-1, 3) for first in (2, 4 + 3 * count)
    )
    return points, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def _read_numbers(path: Path, width: int) -> Float[np.ndarray, "n w"]:
    words = _words(path)
    if not words or len(words) % width:
        raise InputError(f"rows of {width} numbers in {path.name}", f"{len(words)}", "take the file as published")
    return np.array(words, dtype=np.float64).reshape(-1, width)


def _read_pose(path: Path) -> Pose:
    """Nine numbers of a rotation, row by row, then the translation."""
    numbers = _read_numbers(path, 12)[0]
    u, _, w = np.linalg.svd(numbers[:9].reshape(3, 3))  # they have six digits
    return Pose.of(u @ w, numbers[9:], FRAME, CLOUD)


def _words(path: Path) -> list[str]:
    if not path.is_file():
        raise InputError(f"the data of cisstICP, with {path.name}", f"none at {path}", "take the folder as published")
    return path.read_text(encoding="utf-8").split()
