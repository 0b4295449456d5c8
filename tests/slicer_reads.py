"""What 3D Slicer makes of files, told as JSON; for an environment of its own with `slicer-core` (`make slicer`).

    python tests/slicer_reads.py FILE …

Files are read by the classes with which the application reads them. Everything is told as Slicer has it: RAS, mm.
"""

from __future__ import annotations

import json
import sys
from typing import Any

import slicer
import vtk


def main(paths: list[str]) -> None:
    """Prints `{path: what it holds}`."""
    print(json.dumps({path: read(path) for path in paths}))


def read(path: str) -> dict[str, Any]:
    """By the end of the name."""
    scene = slicer.vtkMRMLScene()
    if path.endswith((".tfm", ".h5")):
        node = _read(scene, path, slicer.vtkMRMLTransformStorageNode(), slicer.vtkMRMLTransformNode())
        matrix = vtk.vtkMatrix4x4()
        node.GetMatrixTransformToParent(matrix)
        return {"to_world": [[matrix.GetElement(i, j) for j in range(4)] for i in range(4)]}
    if path.endswith(".mrk.json"):
        node = _read(scene, path, slicer.vtkMRMLMarkupsJsonStorageNode(), slicer.vtkMRMLMarkupsFiducialNode())
        count = node.GetNumberOfControlPoints()
        return {node.GetNthControlPointLabel(k): list(node.GetNthControlPointPositionWorld(k)) for k in range(count)}
    node = _read(scene, path, slicer.vtkMRMLSegmentationStorageNode(), slicer.vtkMRMLSegmentationNode())
    found = node.GetSegmentation()
    segments = [found.GetNthSegment(k) for k in range(found.GetNumberOfSegments())]
    return {segment.GetName(): _middle(node, found.GetNthSegmentID(k)) for k, segment in enumerate(segments)}


def _read(scene: Any, path: str, storage: Any, node: Any) -> Any:
    scene.AddNode(storage)
    scene.AddNode(node)
    storage.SetFileName(path)
    if not storage.ReadData(node):
        raise SystemExit(f"Slicer cannot read {path}")
    return node


def _middle(node: Any, segment: str) -> list[float] | None:
    middle = node.GetSegmentCenterRAS(segment)
    return None if middle is None else list(middle)


if __name__ == "__main__":
    main(sys.argv[1:])
