"""Downloads against a real server on this machine that misbehaves in each way that servers do."""

from __future__ import annotations

import errno
import hashlib
import http.client
import json
import os
import socket
import ssl
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import numpy as np
import pytest

from naris.errors import DiskFull, FetchError
from naris.fetch import COLLECTIONS, Collection, FetchConfig, RemoteFile, cache_folder, fetch

CONTENT = np.random.default_rng(0).bytes(300_000)
SMALL = b"a second, small file\n"
FAST = FetchConfig(attempts=3, timeout_s=5.0, pause_s=0.01)


@dataclass
class Behaviour:
    """What the server does, and what it was asked."""

    files: dict[str, bytes] = field(default_factory=lambda: {"/data/big.bin": CONTENT, "/data/small.txt": SMALL})
    ranges: bool = True
    break_after: list[int] = field(default_factory=list)  # bytes that each of the first answers sends before it breaks
    reset: bool = False
    refuse: list[int] = field(default_factory=list)  # HTTP status of each of the first answers
    hide_length: bool = False
    asked: list[tuple[str, str | None]] = field(default_factory=list)


@contextmanager
def server(behaviour: Behaviour) -> Iterator[str]:
    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            wanted = self.headers.get("Range")
            behaviour.asked.append((self.path, wanted))
            if behaviour.refuse:
                self.send_error(behaviour.refuse.pop(0))
                return
            body = behaviour.files.get(self.path)
            if body is None:
                self.send_error(404)
                return
            start = int(wanted.removeprefix("bytes=").removesuffix("-")) if wanted and behaviour.ranges else 0
            if start >= len(body) and start:
                self.send_error(416)
                return
            self.send_response(206 if start else 200)
            if start:
                self.send_header("Content-Range", f"bytes {start}-{len(body) - 1}/{len(body)}")
            if not behaviour.hide_length:
                self.send_header("Content-Length", str(len(body) - start))
            self.end_headers()
            sent = body[start:]
            if behaviour.break_after:
                sent = sent[: behaviour.break_after.pop(0)]
            self.wfile.write(sent)
            if behaviour.reset and not behaviour.break_after:
                behaviour.reset = False
                linger_zero = b"\1\0\0\0\0\0\0\0"
                self.connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, linger_zero)

        def log_message(self, *words: object) -> None:
            pass

    listening = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    thread = threading.Thread(target=listening.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield f"http://127.0.0.1:{listening.server_port}/data"
    finally:
        listening.shutdown()
        thread.join()
        listening.server_close()


def collection(url: str) -> Collection:
    files = tuple(
        RemoteFile(name, name, hashlib.sha256(body).hexdigest(), len(body))
        for name, body in (("big.bin", CONTENT), ("small.txt", SMALL))
    )
    return Collection("test", "two files", "none needed", url, files)


class Counter:
    """Progress that adds up."""

    def __init__(self) -> None:
        self.total, self.done = 0, 0

    @contextmanager
    def task(self, name: str, total: int):
        self.total = total

        def advance(steps: int) -> None:
            assert steps > 0
            self.done += steps

        yield advance


def test_files_come_whole_and_a_second_run_asks_nothing(tmp_path) -> None:
    behaviour, counter = Behaviour(), Counter()
    with server(behaviour) as url:
        paths = fetch(collection(url), tmp_path / "deep" / "er", FAST, counter)
        assert [path.read_bytes() for path in paths] == [CONTENT, SMALL]
        assert counter.done == counter.total == len(CONTENT) + len(SMALL)
        asked = len(behaviour.asked)
        assert fetch(collection(url), tmp_path / "deep" / "er", FAST) == paths
    assert len(behaviour.asked) == asked == 2
    assert sorted(p.name for p in paths[0].parent.iterdir()) == ["big.bin", "small.txt"]


def test_a_file_that_was_changed_is_replaced(tmp_path) -> None:
    (tmp_path / "small.txt").write_bytes(SMALL.upper())
    with server(Behaviour()) as url:
        assert fetch(collection(url), tmp_path, FAST)[1].read_bytes() == SMALL


def test_a_wrong_digest_is_refused_and_nothing_stays(tmp_path) -> None:
    forged = bytearray(CONTENT)
    forged[1234] ^= 1
    with server(Behaviour(files={"/data/big.bin": bytes(forged)})) as url, pytest.raises(FetchError, match="SHA-256"):
        fetch(collection(url), tmp_path, FAST)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("reset", [False, True], ids=["closed early", "reset"])
def test_a_broken_connection_goes_on_where_it_stopped(tmp_path, reset) -> None:
    behaviour, counter = Behaviour(break_after=[100_000, 50_000], reset=reset), Counter()
    with server(behaviour) as url:
        assert fetch(collection(url), tmp_path, FAST, counter)[0].read_bytes() == CONTENT
    big = [wanted for path, wanted in behaviour.asked if path.endswith("big.bin")]
    assert big[0] is None and len(big) == 3
    assert all(int(wanted.removeprefix("bytes=").removesuffix("-")) > 0 for wanted in big[1:])
    assert counter.done == counter.total


@pytest.mark.parametrize(
    "failure",
    [
        OSError(errno.EHOSTUNREACH, "No route to host"),
        OSError(errno.ENETUNREACH, "Network is unreachable"),
        ssl.SSLError(1, "[SSL: DECRYPTION_FAILED_OR_BAD_RECORD_MAC] decryption failed or bad record mac"),
    ],
    ids=["no route", "no network", "TLS"],
)
def test_a_network_that_goes_away_within_a_file_is_tried_again(tmp_path, monkeypatch, failure: OSError) -> None:
    class Fading(http.client.HTTPResponse):
        """The first answer brings one piece and fails."""

        began = False

        def read1(self, n: int = -1) -> bytes:
            if failures and self.began:
                raise failures.pop()
            self.began = True
            return super().read1(min(n, 1000))

    failures = [failure]
    monkeypatch.setattr(http.client.HTTPConnection, "response_class", Fading)
    behaviour = Behaviour()
    with server(behaviour) as url:
        assert fetch(collection(url), tmp_path, FAST)[0].read_bytes() == CONTENT
    assert behaviour.asked[1] == ("/data/big.bin", "bytes=1000-")


def test_a_file_that_cannot_be_written_is_no_trouble_of_the_network(tmp_path) -> None:
    behaviour = Behaviour()
    (tmp_path / ".big.bin.part").mkdir()
    with server(behaviour) as url, pytest.raises(IsADirectoryError):
        fetch(collection(url), tmp_path, FAST)
    assert len(behaviour.asked) == 1


def test_the_next_run_goes_on_where_the_last_one_gave_up(tmp_path) -> None:
    behaviour = Behaviour(break_after=[70_000, 0, 0])
    with server(behaviour) as url:
        with pytest.raises(FetchError, match="70000 of 300000 bytes"):
            fetch(collection(url), tmp_path, FAST)
        assert not (tmp_path / "big.bin").exists()
        behaviour.asked.clear()
        assert fetch(collection(url), tmp_path, FAST)[0].read_bytes() == CONTENT
    assert behaviour.asked[0] == ("/data/big.bin", "bytes=70000-")


def test_a_server_without_ranges_starts_over(tmp_path) -> None:
    behaviour, counter = Behaviour(ranges=False, break_after=[100_000]), Counter()
    with server(behaviour) as url:
        assert fetch(collection(url), tmp_path, FAST, counter)[0].read_bytes() == CONTENT
    assert behaviour.asked[1] == ("/data/big.bin", "bytes=100000-")
    assert counter.done == counter.total


@pytest.mark.parametrize("rubbish", [b"x" * 1000, b"x" * len(CONTENT), b"x" * (len(CONTENT) + 1)])
def test_rubbish_from_before_does_no_harm(tmp_path, rubbish) -> None:
    """A part of something else, of any length: it is thrown away and the file comes whole."""
    (tmp_path / ".big.bin.part").write_bytes(rubbish)
    with server(Behaviour()) as url:
        assert fetch(collection(url), tmp_path, FAST)[0].read_bytes() == CONTENT
    assert sorted(p.name for p in tmp_path.iterdir()) == ["big.bin", "small.txt"]


def test_a_shorter_file_than_published_ends_in_an_error(tmp_path) -> None:
    with (
        server(Behaviour(files={"/data/big.bin": CONTENT[:1000]})) as url,
        pytest.raises(FetchError, match="within 3 attempts"),
    ):
        fetch(collection(url), tmp_path, FAST)
    assert not (tmp_path / "big.bin").exists()


@pytest.mark.parametrize("hide_length", [False, True], ids=["length told", "length hidden"])
def test_too_large_is_refused_before_it_fills_the_disk(tmp_path, hide_length) -> None:
    behaviour = Behaviour(files={"/data/big.bin": CONTENT * 20}, hide_length=hide_length)
    with server(behaviour) as url, pytest.raises(FetchError, match=r"expected 300000 bytes for big\.bin"):
        fetch(collection(url), tmp_path, FAST)
    assert list(tmp_path.iterdir()) == []
    assert len(behaviour.asked) == 1


def test_not_found_is_told_at_once(tmp_path) -> None:
    behaviour = Behaviour(files={})
    with server(behaviour) as url, pytest.raises(FetchError, match="HTTP 404"):
        fetch(collection(url), tmp_path, FAST)
    assert len(behaviour.asked) == 1


def test_a_tired_server_is_asked_again(tmp_path) -> None:
    behaviour = Behaviour(refuse=[503, 429])
    with server(behaviour) as url:
        assert fetch(collection(url), tmp_path, FAST)[0].read_bytes() == CONTENT


def test_nobody_listens(tmp_path) -> None:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        url = f"http://127.0.0.1:{free.getsockname()[1]}"
        with pytest.raises(FetchError, match="run the same command again"):
            fetch(collection(url), tmp_path, FAST)


def test_only_web_addresses(tmp_path) -> None:
    secret = tmp_path / "secret"
    secret.write_bytes(SMALL)
    with pytest.raises(FetchError, match="https://"):
        fetch(collection(f"file://{tmp_path}"), tmp_path / "out", FAST)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_is_told(tmp_path) -> None:
    (tmp_path / ".big.bin.part").symlink_to("/dev/full")
    with server(Behaviour()) as url, pytest.raises(DiskFull, match="room on the disk"):
        fetch(collection(url), tmp_path, FAST)


def test_the_cache_folder_follows_xdg(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert cache_folder() == tmp_path / "naris"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative/is/invalid")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert cache_folder() == tmp_path / "home" / ".cache" / "naris"


def test_the_mean_nose_as_a_user_gets_it(tmp_path, mean_nose_ply) -> None:
    """The verb, in a process of its own, from a server that holds the published files under their published names."""
    published = {file.remote: (mean_nose_ply.parent / file.name) for file in COLLECTIONS["mean-nose"].files}
    behaviour = Behaviour(
        files={f"/data/{remote}": path.read_bytes() for remote, path in published.items()}, break_after=[500_000]
    )
    with server(behaviour) as url:
        command = [sys.executable, "-m", "naris", "fetch", "mean-nose", "--json", "--base-url", url]
        environment = {**os.environ, "XDG_CACHE_HOME": str(tmp_path)}
        done = subprocess.run(command, capture_output=True, text=True, env=environment, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    assert answer["licence"] == "MIT"
    assert (tmp_path / "naris" / "mean-nose" / "ASR.ply").read_bytes() == mean_nose_ply.read_bytes()
    assert [f["sha256"] for f in answer["files"]] == [f.sha256 for f in COLLECTIONS["mean-nose"].files]
    assert len(behaviour.asked) == len(published) + 1
