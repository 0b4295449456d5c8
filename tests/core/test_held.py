"""Two runs never write to one folder, and a killed one leaves nothing in the way."""

from __future__ import annotations

import signal
import subprocess
import sys
from pathlib import Path

import pytest

from naris.cli import main
from naris.core.held import held
from naris.errors import InputError

HOLD = """
import sys, time
from pathlib import Path
from naris.core.held import held
with held(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_another_process_is_refused_until_the_first_is_killed(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("fcntl")
    out = tmp_path / "out"
    with subprocess.Popen([sys.executable, "-c", HOLD, str(out)], stdout=subprocess.PIPE) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == b"held\n"
        with pytest.raises(InputError, match="one run at a time"), held(tmp_path / "x" / ".." / "out"):
            pass
        with held(tmp_path / "another"):
            pass
        assert main(["anatomy", "to-ct", "builtin", "-o", str(out)]) == 2
        assert "one run at a time" in capfd.readouterr().err
        assert not out.exists()
        other.send_signal(signal.SIGKILL)
    with held(out):
        assert not out.exists()
    with held(out):
        pass
