"""The server stands at this machine alone, at a free port."""

from __future__ import annotations

import socket

import pytest

from naris.errors import InputError
from naris.serve import run


def test_a_port_in_use_gives_way_to_the_next_free_one() -> None:
    with run.listen(0) as first:
        host, taken = first.getsockname()
        assert host == "127.0.0.1"
        with run.listen(taken) as second:
            assert taken < second.getsockname()[1] < taken + 50


def test_without_a_free_port_it_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run, "_TRIES", 1)
    with socket.socket() as busy:
        busy.bind(("127.0.0.1", 0))
        busy.listen()
        with pytest.raises(InputError, match=r"a free port from \d+ on, got none of 1; name another with --port"):
            run.listen(busy.getsockname()[1])
