"""The viewer at a port of this machine, until Ctrl-C."""

from __future__ import annotations

import secrets
import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress

import uvicorn
from fastapi import FastAPI

from naris.errors import InputError
from naris.serve.guard import Guard

HOST = "127.0.0.1"
PORT = 8765
_TRIES = 50
_TOKEN_BYTES = 24


def serve(app: FastAPI, port: int, ready: Callable[[str, int], None], token: str | None = None) -> None:
    """Serves to this machine alone until Ctrl-C.

    Args:
        app: what is served.
        port: the first to be tried; the next free one is taken.
        ready: told the address, with its token, and the port.
        token: what the page must bring; a random one by default.

    Raises:
        InputError: if none of the next ports is free.
    """
    token = token or secrets.token_urlsafe(_TOKEN_BYTES)
    listening = listen(port)
    taken = int(listening.getsockname()[1])
    config = uvicorn.Config(
        Guard(app, taken, token), log_level="warning", access_log=False, server_header=False, lifespan="off"
    )
    ready(f"http://{HOST}:{taken}/?token={token}", taken)
    with listening, _terminated_as_interrupted(), suppress(KeyboardInterrupt):
        uvicorn.Server(config).run(sockets=[listening])


@contextmanager
def _terminated_as_interrupted() -> Iterator[None]:
    """SIGTERM, which uvicorn raises again once it has ended, ends no more than Ctrl-C does: what follows is done."""
    if threading.current_thread() is not threading.main_thread():
        yield  # only the main thread is given signals
        return
    before = signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGTERM, before)


def listen(port: int) -> socket.socket:
    """A socket at that port or the next free one; 0 for any.

    Raises:
        InputError: if there is none.
    """
    for candidate in range(port, min(port + _TRIES, 65_536)):
        listening = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listening.bind((HOST, candidate))
            listening.listen()
        except OSError:
            listening.close()
            continue
        return listening
    raise InputError(f"a free port from {port} on", f"none of {_TRIES}", "name another with --port")
