"""The segmentation as other programs read it."""

from __future__ import annotations

from pathlib import Path

import nrrd
import numpy as np
import SimpleITK as sitk

from naris.airway.block import Block
from naris.airway.segment import SEGMENTS, Airway
from naris.airway.segments import SUFFIX, write_segments


def test_segments_have_their_names_places_and_extents(tmp_path: Path) -> None:
    labels = np.zeros((12, 9, 7), dtype=np.uint8)
    labels[1:3, 2:5, 3:6] = 1
    labels[5:9, 2:5, 3:6] = 2
    labels[4, 7, 1] = 3
    origin = np.array([-11.5, 40.25, -300.0])
    block = Block(np.zeros(labels.shape, np.float32), origin, 0.5)
    path = tmp_path / f"nose{SUFFIX}"
    write_segments(Airway(labels, block, block.hu, {}), path)
    image = sitk.ReadImage(str(path))
    assert np.array_equal(sitk.GetArrayFromImage(image).transpose(2, 1, 0), labels)
    for index in ([0, 0, 0], [4, 7, 1], [11, 8, 6]):
        point = image.TransformIndexToPhysicalPoint(index)
        np.testing.assert_allclose(point, block.points_mm(np.array(index)))  # SimpleITK's world is LPS as well
    header = nrrd.read_header(str(path))
    assert header["space"] == "left-posterior-superior"
    told = [(header[f"Segment{i}_Name"], header[f"Segment{i}_LabelValue"]) for i in range(len(SEGMENTS))]
    assert told == [(name, str(i + 1)) for i, name in enumerate(SEGMENTS)]
    extents = [header[f"Segment{i}_Extent"] for i in range(4)]
    assert extents == ["1 2 2 4 3 5", "5 8 2 4 3 5", "4 4 7 7 1 1", "0 -1 0 -1 0 -1"]
    assert len({header[f"Segment{i}_Color"] for i in range(4)}) == 4
