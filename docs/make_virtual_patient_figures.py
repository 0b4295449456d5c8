"""Draws `figures/virtual_patients.jpg`: 24 virtual patients, each as an endoscope sees it and cut across.

    python docs/make_virtual_patient_figures.py

Six are drawn from the normal ranges of the built-in nose, six are its named variants, six come from a shape model of
eight such noses, six are smooth deformations of the built-in nose. Variants are cut where they differ most from the
nose that they are made of, the others at the middle meatus. Everything comes from the package alone.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
from PIL import Image, ImageDraw

from naris.anatomy.builtin import built_in_nose
from naris.anatomy.builtin.variants import VARIANTS
from naris.anatomy.builtin.variation import virtual_patient
from naris.anatomy.distance import signed_distance
from naris.anatomy.gaussian_process import Deformation, GaussianProcess
from naris.anatomy.shape_model import build_shape_model
from naris.anatomy.transfer import virtual_references
from naris.core.anatomy import Anatomy, Passage
from naris.report.anatomy_sheet import cuts, views_down

FIGURE = Path(__file__).resolve().parent / "figures" / "virtual_patients.jpg"
SEED = 24
OF_A_KIND = 6
MODELLED = 7
SHOWN = (0, 1)  # of the four views down a passage, along it
PASSAGE = "left.middle"
TILE_PX, CUT_PX, LINE_PX = 132, 132, 18
ACROSS = 4
TISSUE = 150  # grey of it in a section without a scan


def main() -> int:
    """Draws them all (a few minutes)."""
    tiles = [tile(nose, said, section_mm) for nose, said, section_mm in patients()]
    rows = [np.concatenate(tiles[i : i + ACROSS], axis=1) for i in range(0, len(tiles), ACROSS)]
    Image.fromarray(np.concatenate(rows)).save(FIGURE, quality=82, optimize=True)
    print(f"{len(tiles)} virtual patients in {FIGURE.name}")
    return 0


def patients() -> Iterator[tuple[Anatomy, str, float]]:
    """Each with what to write above it, and the y at which it is cut."""
    plain = virtual_patient(SEED, 0)
    for number in range(OF_A_KIND):
        yield at_meatus(virtual_patient(SEED, number), f"normal ranges, {number}")
    for variant in VARIANTS:
        nose = virtual_patient(SEED, 0, variant)
        yield nose, variant, most_unlike_mm(nose, plain)
    model = build_shape_model(built_in_nose(), list(virtual_references(MODELLED + 1)))
    for number in range(OF_A_KIND):
        yield at_meatus(model.patient(SEED, number), f"shape model, {number}")
    process = GaussianProcess.around(built_in_nose(), Deformation(amplitude_mm=1.0, cycle_mm=0.6))
    for number in range(OF_A_KIND):
        yield at_meatus(process.patient(SEED, number), f"Gaussian process, {number}")


def at_meatus(nose: Anatomy, said: str) -> tuple[Anatomy, str, float]:
    """A nose with what to write above it, cut at its left middle meatus."""
    return nose, said, float(nose.landmarks_mm["left.middle meatus"][1])


def most_unlike_mm(nose: Anatomy, other: Anatomy) -> float:
    """The y of the coronal section in which the air of two noses differs most."""
    distance, of_other = signed_distance(nose, 1.0), signed_distance(other, 1.0)
    nodes = np.stack(np.meshgrid(*map(np.arange, distance.values_mm.shape), indexing="ij"), axis=-1)
    differs = (distance.values_mm > 0) != (of_other(distance.origin_mm + nodes) > 0)
    return float(distance.origin_mm[1] + differs.sum(axis=(0, 2)).argmax())


def tile(nose: Anatomy, said: str, section_mm: float) -> np.ndarray:
    """Two views down a passage and a coronal section side by side, under a line of text."""
    only = nose.with_(passages=(passage_of(nose),))
    (down,) = views_down(only)
    section = cuts(nose, nose.region_set("anatomical"), through_mm=np.array([0.0, section_mm, 0.0]))[1].image
    shown = [cv2.resize(down.images[i], (TILE_PX, TILE_PX), interpolation=cv2.INTER_AREA) for i in SHOWN]
    picture = np.concatenate([*shown, fitted(section)], axis=1)
    board = Image.new("RGB", (picture.shape[1], LINE_PX), (20, 20, 20))
    ImageDraw.Draw(board).text((4, 3), said, fill=(230, 230, 230))
    framed = np.concatenate([np.array(board), picture])
    return np.pad(framed, ((2, 2), (2, 2), (0, 0)), constant_values=20)


def passage_of(nose: Anatomy) -> Passage:
    """The passage that is looked down."""
    return next((one for one in nose.passages if one.name == PASSAGE), nose.passages[0])


def fitted(section: np.ndarray) -> np.ndarray:
    """The section without the tissue around it, in a square, at its own shape."""
    rows, columns = (np.flatnonzero((section != TISSUE).any(axis=(axis, 2))) for axis in (1, 0))
    section = section[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    height, width = section.shape[:2]
    scale = (CUT_PX - 8) / max(height, width)
    small = cv2.resize(section, (round(width * scale), round(height * scale)), interpolation=cv2.INTER_AREA)
    board = np.full((TILE_PX, CUT_PX, 3), TISSUE, np.uint8)
    top, left = (TILE_PX - small.shape[0]) // 2, (CUT_PX - small.shape[1]) // 2
    board[top : top + small.shape[0], left : left + small.shape[1]] = small
    return board


if __name__ == "__main__":
    sys.exit(main())
