"""`naris steer`: a page at an address with a token, until Ctrl-C; bad input in one sentence and status 2."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from naris.cli import main
from naris.cli.start import BAD_INPUT
from naris.cli.steer import Options, _simulate
from naris.core.pose import Pose
from naris.render.keyframes import Keyframes, write_keyframes
from naris.serve.messages import SimulationAsked
from naris.serve.work import Stopped, Work
from tests.winding_tube import winding_tube


@contextmanager
def steering(*words: str, folder: Path) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "naris", "steer", *words, "--no-browser"]
    with subprocess.Popen(command, cwd=folder, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as child:
        try:
            yield child
        finally:
            child.kill()


def told(child: subprocess.Popen[str]) -> dict[str, object]:
    """The one JSON object, which is printed before the page is served."""
    text = ""
    assert child.stdout is not None
    for line in child.stdout:
        text += line
        if line == "}\n":
            return dict(json.loads(text))
    raise AssertionError(child.stderr.read() if child.stderr else "nothing was told")


@pytest.mark.slow
def test_it_serves_until_ctrl_c(tube: Path, tmp_path: Path) -> None:
    with steering(str(tube), "--port", "0", "--json", folder=tmp_path) as child:
        said = told(child)
        address = str(said["address"])
        assert address.startswith(f"http://127.0.0.1:{said['port']}/?token=")
        opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        assert b"<title>naris steer</title>" in opener.open(address, timeout=30).read()
        start = json.load(opener.open(address.split("?")[0] + "api/start", timeout=30))
        assert start["keyframesFile"] == "keyframes.json"
        with pytest.raises(urllib.error.HTTPError, match="403"):
            urllib.request.urlopen(address.split("?")[0], timeout=30)
        child.send_signal(signal.SIGINT)
        assert child.wait(30) == 0
        assert "Traceback" not in (child.stderr.read() if child.stderr else "")
    assert list(tmp_path.iterdir()) == []  # nothing was saved, so nothing is there


@pytest.mark.slow
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_what_was_painted_is_written_when_it_ends(tube: Path, tmp_path: Path, ending: signal.Signals) -> None:
    anatomy = winding_tube()
    line = anatomy.passages[0].points_mm
    at = line[len(line) // 2].tolist()
    number = (int(anatomy.region_set().label(line[len(line) // 2])) + 1) % 4
    with steering(str(tube), "--port", "0", "--json", folder=tmp_path) as child:
        address = str(told(child)["address"])
        opener = urllib.request.build_opener(urllib.request.HTTPCookieProcessor())
        opener.open(address, timeout=30).read()
        body = json.dumps({"region": number, "radius_mm": 4, "points": [at]}).encode()
        paint = urllib.request.Request(
            address.split("?")[0] + "api/regions/paint", body, {"content-type": "application/json"}
        )
        assert opener.open(paint, timeout=30).status == 200
        child.send_signal(ending)
        assert child.wait(30) == 0
    assert (tmp_path / "regions-1.json").exists()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["steer"], "expected ANATOMY"),
        (["steer", "nothing-there"], "nothing-there"),
        (["steer", "builtin", "--port", "70000"], "a port from 0 to 65535"),
        (["steer", "TUBE", "--model", "nothing-there"], "nothing-there"),
        (["steer", "TUBE", "--keyframes", "no-folder/k.json"], "a folder to keep k.json in, got no no-folder; make it"),
    ],
)
def test_bad_input_is_one_sentence(words: list[str], said: str, tube: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main([str(tube) if word == "TUBE" else word for word in words]) == BAD_INPUT
    err = capfd.readouterr().err
    assert said in err
    assert len(err.strip().splitlines()) == 1


def test_a_simulation_that_is_stopped_ends_between_two_pictures(tube: Path, tmp_path: Path) -> None:
    """The real one: what it has made by then is not more than half of all."""
    anatomy = winding_tube()
    line = anatomy.passages[0].points_mm
    middle = line[len(line) // 3 : len(line) // 2]
    forward = np.gradient(middle, axis=0)
    poses = Pose.look(middle[[0, -1]], forward[[0, -1]], np.array([0.0, 0, 1]), anatomy.frame)
    write_keyframes(Keyframes.of(poses, anatomy), tmp_path / "k.json")
    work = Work(running=True)
    asked = SimulationAsked(per_position=400, step_mm=1.0)

    def stop_soon() -> None:
        while work.done == 0:
            time.sleep(0.005)
        work.stopped = True

    stopper = threading.Thread(target=stop_soon, daemon=True)
    stopper.start()
    simulate = _simulate(Options(str(tube)), None)
    with pytest.raises(Stopped):
        simulate(tmp_path / "k.json", tmp_path / "pictures", None, asked, work)
    assert 0 < work.done < work.total // 2
    with pytest.raises(Stopped):
        work.task("another", 1)
