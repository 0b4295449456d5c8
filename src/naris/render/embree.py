"""Embree 4 by its C interface: the library that lies in the `embreex` wheel, loaded with ctypes.

`embreex` itself shoots one ray at a time; packets of coherent rays are three times as fast. Nothing is compiled: the
kernel calls the library's functions by their addresses. See the Embree 4 API manual (embree.github.io/api.html).
"""

from __future__ import annotations

import ctypes
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np
from jaxtyping import Float32, Int32

from naris.errors import EngineUnavailable

_POINTER, _SIZE, _UINT = ctypes.c_void_p, ctypes.c_size_t, ctypes.c_uint
_SIGNATURES: dict[str, tuple[object, list[object]]] = {
    "rtcNewDevice": (_POINTER, [ctypes.c_char_p]),
    "rtcReleaseDevice": (None, [_POINTER]),
    "rtcGetDeviceError": (ctypes.c_int, [_POINTER]),
    "rtcGetDeviceProperty": (ctypes.c_ssize_t, [_POINTER, ctypes.c_int]),
    "rtcNewScene": (_POINTER, [_POINTER]),
    "rtcReleaseScene": (None, [_POINTER]),
    "rtcSetSceneBuildQuality": (None, [_POINTER, ctypes.c_int]),
    "rtcSetSceneFlags": (None, [_POINTER, ctypes.c_int]),
    "rtcCommitScene": (None, [_POINTER]),
    "rtcNewGeometry": (_POINTER, [_POINTER, ctypes.c_int]),
    "rtcReleaseGeometry": (None, [_POINTER]),
    "rtcCommitGeometry": (None, [_POINTER]),
    "rtcAttachGeometry": (_UINT, [_POINTER, _POINTER]),
    "rtcSetNewGeometryBuffer": (_POINTER, [_POINTER, ctypes.c_int, _UINT, ctypes.c_int, _SIZE, _SIZE]),
}
_TRIANGLES, _INDEX, _VERTEX, _UINT3, _FLOAT3 = 0, 0, 1, 0x5003, 0x9003
_VERSION = 0
_NATIVE_PROPERTY = ((16, 34), (8, 33), (4, 32))

_LOW_QUALITY, _HIGH_QUALITY = 0, 2
_FLAG_COHERENT = 1 << 16
_FEATURE_TRIANGLE = 1 << 1


class IntersectArguments(ctypes.Structure):
    """`RTCIntersectArguments`: whether the rays of a packet are coherent, and that all geometry is triangles."""

    _fields_ = (
        ("flags", ctypes.c_int),
        ("feature_mask", ctypes.c_int),
        ("context", ctypes.c_void_p),
        ("filter", ctypes.c_void_p),
        ("intersect", ctypes.c_void_p),
        ("min_width_distance_factor", ctypes.c_float),
        ("reserved", ctypes.c_float * 4),
    )


ARGUMENTS = IntersectArguments(flags=_FLAG_COHERENT, feature_mask=_FEATURE_TRIANGLE)
SCATTERED = IntersectArguments(flags=0, feature_mask=_FEATURE_TRIANGLE)
"""For packets of few rays over a whole view, from ever other poses: a third quicker."""


@dataclass(frozen=True)
class Library:
    """The loaded library and one device, for the life of the process.

    Attributes:
        functions: the shared library.
        device: address of its device.
        width: rays in a packet, 16 where the processor has registers for it, else 8 or 4.
    """

    functions: ctypes.CDLL
    device: int
    width: int

    @property
    def intersect(self) -> int:
        """Address of `rtcIntersect16`, `…8` or `…4`: no other than the device's own width may be called."""
        return ctypes.cast(getattr(self.functions, f"rtcIntersect{self.width}"), ctypes.c_void_p).value or 0


@lru_cache(maxsize=1)
def library() -> Library:
    """The library in the `embreex` wheel.

    Raises:
        EngineUnavailable: if it is not there, not Embree 4, or makes no device.
    """
    functions = ctypes.CDLL(str(_find()))
    try:
        for name, (result, arguments) in _SIGNATURES.items():
            function = getattr(functions, name)
            function.restype, function.argtypes = result, arguments
    except AttributeError as error:
        raise EngineUnavailable("a complete Embree library", f"{error}", "reinstall embreex") from error
    # No "threads=1" here: another device of the process (that of embreex) allows more, and the two limits together keep
    # a worker of the shared thread pool spinning for ever.
    device = functions.rtcNewDevice(b"")
    if not device:
        raise EngineUnavailable("an Embree device", f"error {functions.rtcGetDeviceError(None)}", "use engine numpy")
    version = functions.rtcGetDeviceProperty(device, _VERSION)
    if version // 10000 != 4:
        raise EngineUnavailable("Embree 4", f"version {version}", "install embreex 4")
    widths = [width for width, asked in _NATIVE_PROPERTY if functions.rtcGetDeviceProperty(device, asked)]
    if not widths:
        raise EngineUnavailable("an Embree with ray packets", "one without", "use engine numpy")
    return Library(functions, device, widths[0])


def _find() -> Path:
    try:
        import embreex.rtcore_scene
    except ImportError as error:
        raise EngineUnavailable("the package embreex", f"{error}", "install embreex for this platform") from error
    package = Path(embreex.__file__).parent
    for folder in (package.parent / "embreex.libs", package / ".dylibs", package):
        found = sorted(p for p in folder.glob("*embree4*") if p.suffix not in (".py", ".pxd"))
        if found:
            return found[0]
    raise EngineUnavailable("libembree4 in the embreex wheel", f"none beside {package.name}", "use engine numpy")


class PacketScene:
    """A surface in Embree, ready for packets.

    Args:
        vertices_mm, faces: of the surface.
        brief: it is looked at a few times only: built in a fraction of the time, slower to shoot at.

    Attributes:
        address: of the `RTCScene`, while this object lives.

    Raises:
        EngineUnavailable: if Embree does not accept the surface.
    """

    def __init__(
        self, vertices_mm: Float32[np.ndarray, "v 3"], faces: Int32[np.ndarray, "f 3"], *, brief: bool = False
    ) -> None:
        self._library = library()
        rtc, device = self._library.functions, self._library.device
        self.address: int = rtc.rtcNewScene(device)
        geometry = rtc.rtcNewGeometry(device, _TRIANGLES)
        self._fill(geometry, _VERTEX, _FLOAT3, vertices_mm)
        self._fill(geometry, _INDEX, _UINT3, faces)
        rtc.rtcCommitGeometry(geometry)
        rtc.rtcAttachGeometry(self.address, geometry)
        rtc.rtcReleaseGeometry(geometry)
        rtc.rtcSetSceneBuildQuality(self.address, _LOW_QUALITY if brief else _HIGH_QUALITY)
        rtc.rtcCommitScene(self.address)
        error = rtc.rtcGetDeviceError(device)
        if error:
            raise EngineUnavailable("a scene in Embree", f"error {error}", "use engine numpy")

    def _fill(self, geometry: int, kind: int, form: int, rows: np.ndarray) -> None:
        rtc = self._library.functions
        address = rtc.rtcSetNewGeometryBuffer(geometry, kind, 0, form, rows.strides[0], len(rows))
        if not address:
            raise EngineUnavailable("room for the surface in Embree", "none", "use a coarser surface")
        ctypes.memmove(address, rows.ctypes.data, rows.nbytes)

    def __del__(self) -> None:
        address = getattr(self, "address", None)
        if address:
            self._library.functions.rtcReleaseScene(address)
