"""Files are there whole or not at all."""

from __future__ import annotations

import errno
import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from naris.core.atomic import (
    PART,
    check_reachable,
    check_writable,
    replacing,
    to_json,
    write_bytes,
    write_json,
    write_text,
)
from naris.errors import DiskFull, InputError


def left_behind(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if PART in path.name]


def test_a_file_is_made_with_its_folder_and_replaced(tmp_path) -> None:
    path = tmp_path / "a" / "b" / "file.txt"
    write_text(path, "one\n")
    write_bytes(path, b"two")
    assert path.read_bytes() == b"two"
    assert left_behind(path.parent) == []


def test_the_new_file_has_ordinary_permissions(tmp_path) -> None:
    write_bytes(tmp_path / "ours", b"")
    (tmp_path / "plain").write_bytes(b"")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_when_writing_fails_the_old_file_stays(tmp_path) -> None:
    path = tmp_path / "file.json"
    write_json(path, {"a": 1})
    with pytest.raises(ValueError, match="JSON compliant"):
        write_json(path, {"a": float("nan")})
    with pytest.raises(ZeroDivisionError), replacing(path) as part:
        part.write_text("half")
        raise ZeroDivisionError
    assert json.loads(path.read_text()) == {"a": 1}
    assert left_behind(tmp_path) == []


def test_the_part_has_the_suffix_that_libraries_look_at(tmp_path) -> None:
    with replacing(tmp_path / "picture.png") as part:
        assert part.suffix == ".png"
        assert part.parent == tmp_path
        part.write_bytes(b"x")
    assert (tmp_path / "picture.png").exists()


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EDQUOT])
def test_a_full_disk_is_told_and_the_old_file_stays(tmp_path, number) -> None:
    path = tmp_path / "file"
    write_bytes(path, b"old")
    with pytest.raises(DiskFull, match="free some space"), replacing(path):
        raise OSError(number, os.strerror(number))
    assert path.read_bytes() == b"old"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_device_that_is_full(tmp_path) -> None:
    with pytest.raises(DiskFull), replacing(tmp_path / "file") as part:
        part.symlink_to("/dev/full")
        part.write_bytes(b"x" * 100_000)
    assert list(tmp_path.iterdir()) == []


def test_other_troubles_keep_their_own_words(tmp_path) -> None:
    (tmp_path / "file").write_bytes(b"")
    with pytest.raises(OSError, match=r"file'$|below'$") as caught:
        write_bytes(tmp_path / "file" / "below", b"")
    assert isinstance(caught.value, (NotADirectoryError, FileExistsError))


def test_a_place_to_write_is_looked_at_before_the_work(tmp_path) -> None:
    check_writable(tmp_path / "new" / "result.json")
    assert [path.name for path in tmp_path.iterdir()] == ["new"]
    (tmp_path / "file").write_text("kept")
    check_writable(tmp_path / "file")
    for path in (tmp_path / "file" / "below.json", tmp_path / "new"):
        with pytest.raises(InputError, match="give another path"):
            check_writable(path)
    assert (tmp_path / "file").read_text() == "kept"
    assert list((tmp_path / "new").iterdir()) == []


def test_a_reader_never_sees_half_a_file_of_a_writer_that_is_killed(tmp_path) -> None:
    """A process that does nothing but replace a file is killed at a random moment, several times over."""
    path = tmp_path / "file"
    program = (
        "import sys; from pathlib import Path; from naris.core.atomic import write_bytes\n"
        "path = Path(sys.argv[1]); n = 0\n"
        "while True:\n"
        "    write_bytes(path, bytes([n % 256]) * 2_000_000, durable=False); n += 1\n"
        "    print(flush=True)\n"
    )
    for _ in range(3):
        with subprocess.Popen([sys.executable, "-c", program, str(path)], stdout=subprocess.PIPE) as writer:
            for _ in range(5):
                writer.stdout.readline()
                assert len(set(path.read_bytes())) == 1
            writer.send_signal(signal.SIGKILL)
        content = path.read_bytes()
        assert len(content) == 2_000_000
        assert len(set(content)) == 1


def test_json_knows_numpy_and_paths() -> None:
    value = {"a": np.float32(0.5), "b": np.arange(3), "c": Path("x/y"), "d": np.bool_(True), "µ": "°"}
    assert json.loads(to_json(value)) == {"a": 0.5, "b": [0, 1, 2], "c": "x/y", "d": True, "µ": "°"}
    with pytest.raises(TypeError, match="complex"):
        to_json({"a": 1j})


def test_a_place_that_cannot_be_written_is_told_before_the_work(tmp_path: Path) -> None:
    check_reachable(tmp_path / "a" / "b" / "c.json")
    assert not (tmp_path / "a").exists()
    (tmp_path / "file").write_text("")
    check_reachable(tmp_path / "file")
    with pytest.raises(InputError, match="no folder"):
        check_reachable(tmp_path / "file" / "b")


@pytest.mark.skipif(getattr(os, "getuid", lambda: 1)() == 0, reason="the superuser may write everywhere")
def test_a_folder_without_permission_is_told(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(InputError, match="nothing may be written"):
        check_reachable(tmp_path / "a")
