"""Who may talk to a server on this machine: a page that was opened with its token, and no other site.

A server that binds to 127.0.0.1 is still within reach of every page that the browser shows. So each request must name
this very host (or a name that was rebound to 127.0.0.1 gets in), must not come from a page of another origin, and must
bring the token, once in the address and from then on in a cookie that scripts cannot read.
"""

from __future__ import annotations

import secrets
from collections.abc import Awaitable, Callable, MutableMapping
from typing import Any
from urllib.parse import parse_qs

Scope = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[MutableMapping[str, Any]]]
Send = Callable[[MutableMapping[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

_HEADERS = {
    "content-security-policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; media-src blob:; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "x-content-type-options": "nosniff",
    "referrer-policy": "no-referrer",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "cache-control": "no-store",
}


class Guard:
    """Lets requests through to an application, or answers 403.

    Args:
        app: the application.
        port: that it is served at.
        token: that the page is opened with.
    """

    def __init__(self, app: App, port: int, token: str) -> None:
        self._app, self._token, self._cookie = app, token, f"naris-{port}"
        self._hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        if scope["type"] != "http":
            if scope["type"] == "lifespan":
                await self._app(scope, receive, send)
            return
        headers = {name.decode("latin-1").lower(): value.decode("latin-1") for name, value in scope["headers"]}
        host, origin = headers.get("host", ""), headers.get("origin")
        given = parse_qs(scope["query_string"].decode("latin-1")).get("token", [""])[0]
        # A page of another port is the same site for cookies, and its pictures and links name no origin.
        is_foreign = headers.get("sec-fetch-site", "none") not in ("same-origin", "none")
        is_entrance = scope["path"] == "/" and self._is_token(given)
        if host not in self._hosts or origin not in (None, f"http://{host}") or (is_foreign and not is_entrance):
            await _refuse(send, "this page is for the address that naris steer printed, and for no other site")
        elif is_entrance:
            # Out of the address, so that it stays in no bookmark; what comes after # stays.
            cookie = f"{self._cookie}={self._token}; HttpOnly; SameSite=Strict; Path=/"
            await _answer(send, 303, {"location": "/", "set-cookie": cookie}, "")
        elif self._is_token(_cookies(headers.get("cookie", "")).get(self._cookie, "")):
            await self._app(scope, receive, _with_headers(send))
        else:
            await _refuse(send, "open the whole address that naris steer printed, with its token")

    def _is_token(self, given: str) -> bool:
        return secrets.compare_digest(given.encode(), self._token.encode())


def _cookies(header: str) -> dict[str, str]:
    """By hand: one that another program on this machine has set, and that is none by the book, must not hide ours."""
    pairs = (part.partition("=") for part in header.split(";"))
    return {name.strip(): value.strip() for name, _, value in pairs}


def _with_headers(send: Send) -> Send:
    async def sending(message: MutableMapping[str, Any]) -> None:
        if message["type"] == "http.response.start":
            message["headers"] = [*message["headers"], *_encoded(_HEADERS)]
        await send(message)

    return sending


async def _refuse(send: Send, why: str) -> None:
    await _answer(send, 403, {"content-type": "text/plain; charset=utf-8"}, f"naris: {why}\n")


async def _answer(send: Send, status: int, headers: dict[str, str], body: str) -> None:
    await send({"type": "http.response.start", "status": status, "headers": _encoded(headers | _HEADERS)})
    await send({"type": "http.response.body", "body": body.encode()})


def _encoded(headers: dict[str, str]) -> list[tuple[bytes, bytes]]:
    return [(name.encode("latin-1"), value.encode("latin-1")) for name, value in headers.items()]
