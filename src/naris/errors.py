"""The exceptions of naris, all in one tree.

NarisError
├── InputError                  what the user gave cannot be used (exit status 2)
│   ├── ScanError               not a CT, or one whose geometry is incomplete or contradicts itself
│   ├── SurfaceError            not a mesh, open, inside out, in the wrong unit
│   ├── PoseError               not a rigid transform, NaN, wrong frame, outside the lumen
│   ├── RegionError             unknown region, or a model made for other regions
│   ├── KeyframeError           a keyframe file that cannot be read or used
│   ├── ImageError              not a picture, or one of the wrong size
│   ├── DatasetError            a data set that is incomplete or inconsistent
│   ├── ConfigurationChanged    the output was made with other settings
│   ├── CheckpointError         a weights file that is truncated or of another network
│   └── FetchError              a download that failed or has the wrong digest
└── MachineError                what naris needs from the machine is missing (exit status 2)
    ├── DiskFull                no room to write
    ├── OutOfMemory             too little memory for what was asked
    └── EngineUnavailable       the asked rendering engine cannot start here

Every message is one sentence in three parts: what was expected, what came, what to do.
"""

from __future__ import annotations

import re


class NarisError(Exception):
    """The root of every error that naris raises on purpose.

    `expected`, `got` and `todo` are clauses without a full stop; the message joins them.
    """

    def __init__(self, expected: str, got: str | None = None, todo: str | None = None) -> None:
        self.expected, self.got, self.todo = expected, got, todo
        message = f"expected {expected}" if got is not None else expected
        if got is not None:
            message += f", got {got}"
        if todo is not None:
            message += f"; {todo}"
        super().__init__(message)


class InputError(NarisError):
    """What the user gave cannot be used."""


class ScanError(InputError):
    """The scan is not a CT that can be read, or its geometry is incomplete or contradicts itself."""


class SurfaceError(InputError):
    """The surface is not a mesh, is open, inside out, or in the wrong unit."""


class PoseError(InputError):
    """The pose is not a rigid transform, is not finite, or stands in the wrong frame or place."""


class RegionError(InputError):
    """The region is unknown, or the model was made for other regions."""


class KeyframeError(InputError):
    """The keyframe file cannot be read or used."""


class ImageError(InputError):
    """The file is not a picture, or one of the wrong size."""


class DatasetError(InputError):
    """The data set is incomplete or inconsistent."""


class ConfigurationChanged(InputError):
    """The output folder was made with other settings."""


class CheckpointError(InputError):
    """The weights file is truncated, damaged, or belongs to another network."""


class FetchError(InputError):
    """The download failed or what came has the wrong digest."""


class MachineError(NarisError):
    """What naris needs from the machine is missing."""


class DiskFull(MachineError):
    """There is no room to write."""


class OutOfMemory(MachineError):
    """There is too little memory for what was asked."""

    @classmethod
    def of(cls, what: str, error: BaseException) -> OutOfMemory:
        """For `what` was asked, such as `to read scan.nrrd`; says how much could not be had where the error knows."""
        size = re.search(r"allocate (\d+(?:\.\d+)?)\.? (\w+)", str(error))
        got = f"none for another {size[1]} {size[2]}" if size else "too little"
        return cls(f"memory enough {what}", got, "crop the scan, end other programs or take a larger machine")


class EngineUnavailable(MachineError):
    """The asked rendering engine cannot start on this machine."""
