"""The viewer as an application: which path gives what; a request that cannot be met is answered in one sentence."""

from __future__ import annotations

import io
from importlib import resources
from typing import Annotated

import numpy as np
from fastapi import FastAPI, Query, Request, Response
from fastapi.concurrency import run_in_threadpool
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from jaxtyping import UInt8
from PIL import Image

from naris.core.pictures import check_array
from naris.errors import ImageError, InputError, NarisError
from naris.serve.messages import FrameAsked, LensTold, PoseTold, SlicesAsked, StrokeTold, UndoTold
from naris.serve.viewer import Viewer

_MODULES = (
    "brush",
    "controls",
    "exact",
    "flight",
    "inside",
    "keys",
    "leftovers",
    "merge",
    "model",
    "outside",
    "painting",
    "parcel",
    "pointers",
    "room",
    "shaders",
    "slices",
    "steer",
    "strip",
    "talk",
    "touch",
    "travel",
    "ui",
    "video",
    "work",
)
STATIC = {
    "": ("index.html", "text/html; charset=utf-8"),
    "steer.css": ("steer.css", "text/css; charset=utf-8"),
    **{f"{name}.js": (f"{name}.js", "text/javascript; charset=utf-8") for name in _MODULES},
    "vendor/three.module.min.js": ("vendor/three.module.min.js", "text/javascript; charset=utf-8"),
}
"""All files that are served, by the path after the host: nothing else is."""

_BINARY = "application/octet-stream"
_EXPORTS = {"json": "keyframes.json", "original": "keyframes.zip"}
_MOST_BYTES = 64 << 20
_MOST_PIXELS = 64_000_000


def application(viewer: Viewer) -> FastAPI:
    """All that the page of a viewer asks for."""
    app = FastAPI(title="naris", docs_url=None, redoc_url=None, openapi_url=None)
    app.add_exception_handler(NarisError, _refused)
    app.add_exception_handler(RequestValidationError, _unfit)
    _looking(app, viewer)
    _keyframes(app, viewer)
    _painting(app, viewer)
    _believing(app, viewer)
    app.add_api_route("/{path:path}", _static, methods=["GET"], response_model=None)
    return app


def _looking(app: FastAPI, viewer: Viewer) -> None:
    def start() -> JSONResponse:
        return JSONResponse(viewer.start())

    def parcel(name: str) -> Response:
        if name not in viewer.PARCELS:
            return _nothing(name)
        return Response(viewer.parcel(name), media_type=_BINARY)

    def frame(asked: FrameAsked) -> Response:
        return Response(_png(viewer.frame(asked)), media_type="image/png")

    def slices(asked: SlicesAsked) -> Response:
        return Response(_png(viewer.sliced(asked)), media_type="image/png")

    app.add_api_route("/api/slices", slices, methods=["POST"], response_model=None)
    app.add_api_route("/api/start", start, methods=["GET"], response_model=None)
    app.add_api_route("/api/parcel/{name}", parcel, methods=["GET"], response_model=None)
    app.add_api_route("/api/frame", frame, methods=["POST"], response_model=None)


def _keyframes(app: FastAPI, viewer: Viewer) -> None:
    def told() -> JSONResponse:
        return JSONResponse(viewer.told_keyframes())

    async def taken(request: Request, name: str = "") -> JSONResponse:
        data = await _body(request)
        return JSONResponse({"keyframes": await run_in_threadpool(viewer.taken, data, name)})

    def exported(kind: str, lens: Annotated[LensTold, Query()]) -> Response:
        if kind not in _EXPORTS:
            return _nothing(kind)
        header = {"content-disposition": f'attachment; filename="{_EXPORTS[kind]}"'}
        return Response(viewer.exported(kind, lens), media_type=_BINARY, headers=header)

    def trajectory(step_mm: Annotated[float, Query(ge=0.01, le=100)] = 1.0) -> JSONResponse:
        return JSONResponse({"poses": viewer.trajectory(step_mm)})

    def work() -> JSONResponse:
        return JSONResponse(viewer.told_work())

    app.add_api_route("/api/keyframes", told, methods=["GET"], response_model=None)
    app.add_api_route("/api/keyframes", viewer.keep, methods=["PUT"], response_model=None)
    app.add_api_route("/api/keyframes/import", taken, methods=["POST"], response_model=None)
    app.add_api_route("/api/keyframes/export/{kind}", exported, methods=["GET"], response_model=None)
    app.add_api_route("/api/trajectory", trajectory, methods=["GET"], response_model=None)
    app.add_api_route("/api/simulate", work, methods=["GET"], response_model=None)
    app.add_api_route("/api/simulate", viewer.begin, methods=["POST"], response_model=None)
    app.add_api_route("/api/simulate/stop", lambda: JSONResponse(viewer.stop()), methods=["POST"], response_model=None)


def _painting(app: FastAPI, viewer: Viewer) -> None:
    def paint(asked: StrokeTold) -> Response:
        return Response(viewer.paint(asked), media_type=_BINARY)

    def undo(asked: UndoTold) -> Response:
        return Response(viewer.unpaint(asked), media_type=_BINARY)

    def save() -> JSONResponse:
        return JSONResponse(viewer.save_regions())

    app.add_api_route("/api/regions/paint", paint, methods=["POST"], response_model=None)
    app.add_api_route("/api/regions/undo", undo, methods=["POST"], response_model=None)
    app.add_api_route("/api/regions/save", save, methods=["POST"], response_model=None)


def _believing(app: FastAPI, viewer: Viewer) -> None:
    async def located(request: Request) -> JSONResponse:
        data = await _body(request)
        return JSONResponse(await run_in_threadpool(lambda: viewer.believed(_picture(data))))

    def believed(asked: PoseTold) -> JSONResponse:
        return JSONResponse(viewer.believed_here(asked.pose))

    app.add_api_route("/api/locate", located, methods=["POST"], response_model=None)
    app.add_api_route("/api/believed", believed, methods=["POST"], response_model=None)


def _static(path: str) -> Response:
    if path not in STATIC:
        return _nothing(path)
    name, kind = STATIC[path]
    return Response(resources.files("naris.serve").joinpath("static", name).read_bytes(), media_type=kind)


def _nothing(path: str) -> JSONResponse:
    return JSONResponse({"error": f"there is no {path}"}, 404)


def _refused(request: Request, error: Exception) -> JSONResponse:
    return JSONResponse({"error": str(error)}, 400)


def _unfit(request: Request, error: Exception) -> JSONResponse:
    first = error.errors()[0] if isinstance(error, RequestValidationError) else {"loc": (), "msg": str(error)}
    where = ".".join(map(str, first["loc"]))
    return JSONResponse({"error": f"expected what this page sends, got {where}: {first['msg']}; load it again"}, 422)


async def _body(request: Request) -> bytes:
    data = bytearray()
    async for part in request.stream():
        data += part
        if len(data) > _MOST_BYTES:
            raise InputError(f"a file of at most {_MOST_BYTES >> 20} MB", "a larger one", "give a smaller one")
    return bytes(data)


def _picture(data: bytes) -> UInt8[np.ndarray, "h w 3"]:
    try:
        with Image.open(io.BytesIO(data)) as picture:
            if picture.width * picture.height > _MOST_PIXELS:
                raise ImageError("a picture of at most 64 megapixels", "a larger one", "shrink it")
            return check_array(np.asarray(picture.convert("RGB")))
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        raise ImageError("a picture (PNG, JPEG, WebP)", "something else", "drop a picture") from error


def _png(image: UInt8[np.ndarray, "h w 3"]) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="PNG", compress_level=1)
    return buffer.getvalue()
