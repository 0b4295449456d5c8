"""3D Slicer's own readers on what we write for it: the camera, landmarks and segments lie where we say.

Slicer's libraries come as a wheel of some 40 MB with VTK behind it, for an environment of its own: `make slicer` sets
it up and runs this. Without it these tests are skipped.
"""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from naris.airway.block import Block
from naris.airway.segment import SEGMENTS, Airway
from naris.airway.segments import SUFFIX, write_segments
from naris.core.atomic import write_json, write_text
from naris.core.pose import CAMERA, Pose
from naris.register.files import slicer_landmarks, slicer_transform, write_slicer_hdf5
from tests.anatomy.test_correspondence import marked_tube

READS, PYTHON = Path(__file__).with_name("slicer_reads.py"), Path(__file__).parents[1] / ".venv-slicer/bin/python"
INSTALLED = PYTHON.parents[1] / ".installed"
POSE = Pose.exp(np.array([10.0, -20.0, 30.0, 0.3, -0.8, 1.1]), "LPS", CAMERA)
RAS = np.array([-1.0, -1.0, 1.0])

pytestmark = pytest.mark.skipif(not INSTALLED.is_file(), reason="no .venv-slicer with slicer-core (make slicer)")


def as_slicer_has_it(*paths: Path) -> list[dict[str, Any]]:
    done = subprocess.run([PYTHON, READS, *paths], capture_output=True, text=True, check=True)
    told = json.loads(done.stdout.splitlines()[-1])
    return [told[str(path)] for path in paths]


def test_a_model_in_the_coordinates_of_the_camera_lies_where_the_camera_is(tmp_path: Path) -> None:
    """Slicer brings a model from LPS to RAS, applies the transform, and shows it in RAS."""
    text, hdf5 = tmp_path / "pose.tfm", tmp_path / "pose.h5"
    write_text(text, slicer_transform(POSE))
    write_slicer_hdf5(POSE, hdf5)
    of_camera = np.random.default_rng(0).uniform(-30, 30, (20, 3))
    for told in as_slicer_has_it(text, hdf5):
        to_world = np.array(told["to_world"])
        shown = (of_camera * RAS) @ to_world[:3, :3].T + to_world[:3, 3]
        np.testing.assert_allclose(shown, POSE.apply(of_camera) * RAS, atol=1e-6)


def test_landmarks_and_the_camera_lie_where_they_are(tmp_path: Path) -> None:
    nose = marked_tube()
    path = tmp_path / "landmarks.mrk.json"
    write_json(path, slicer_landmarks(nose, POSE))
    (told,) = as_slicer_has_it(path)
    expected = {**nose.landmarks_mm, "camera": POSE.position_mm}
    for name, place in expected.items():
        np.testing.assert_allclose(told[name], place * RAS, atol=1e-3)


def test_segments_have_their_names_and_places(tmp_path: Path) -> None:
    labels = np.zeros((40, 30, 24), dtype=np.uint8)
    for k in range(3):
        labels[4 + 10 * k : 9 + 10 * k, 5:12, 3 + 5 * k : 8 + 5 * k] = k + 1
    block = Block(np.zeros(labels.shape, np.float32), np.array([-11.5, 40.25, -300.0]), 0.5)
    path = tmp_path / f"nose{SUFFIX}"
    write_segments(Airway(labels, block, block.hu, {}), path)
    (told,) = as_slicer_has_it(path)
    assert list(told) == list(SEGMENTS)
    for k in range(3):
        middle = block.points_mm(np.argwhere(labels == k + 1).mean(axis=0))
        np.testing.assert_allclose(told[SEGMENTS[k]], middle * RAS, atol=0.5)
