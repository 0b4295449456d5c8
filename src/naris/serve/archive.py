"""Text files in a ZIP archive, which may be anybody's."""

from __future__ import annotations

import io
import re
import zipfile
import zlib
from pathlib import Path

from naris.errors import KeyframeError

_MOST_FILES, _MOST_BYTES, _MOST_LETTERS = 10_000, 16 << 20, 80
_PACKED = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)  # others unpack without bound


def texts_in(archive: bytes, ending: str) -> list[tuple[str, bytes]]:
    """Names, without folders, and contents of the files with an ending, 9 before 10.

    What is unpacked is counted, not believed. Hidden files, such as those of macOS, are left out.

    Raises:
        KeyframeError: if it is no archive, or holds none, too many or too large ones.
    """
    expected = f"a ZIP archive of {ending} files of the original"
    most = f"at most {_MOST_FILES} files of {_MOST_BYTES >> 20} MB together, with names of {_MOST_LETTERS} letters"
    found: list[tuple[str, bytes]] = []
    left = _MOST_BYTES
    try:
        with zipfile.ZipFile(io.BytesIO(archive)) as whole:
            entries = [one for one in whole.infolist() if _is_meant(Path(one.filename), ending)]
            entries.sort(key=lambda one: re.sub(r"\d+", lambda digits: digits.group().zfill(12), one.filename))
            for entry in entries:
                name = Path(entry.filename).name
                if entry.compress_type not in _PACKED:
                    raise KeyframeError(expected, f"{name} packed in another way", "zip them again")
                with whole.open(entry) as file:
                    text = file.read(left + 1)
                left -= len(text)
                if left < 0 or len(found) == _MOST_FILES or len(name) > _MOST_LETTERS:
                    raise KeyframeError(most, "more", "give fewer")
                found.append((name, text))
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, ValueError) as error:
        raise KeyframeError(expected, "something else", "export them again") from error
    if not found:
        raise KeyframeError(expected, "none in it", "export them again")
    return found


def _is_meant(path: Path, ending: str) -> bool:
    return path.name.lower().endswith(ending) and not path.name.startswith(".") and "__MACOSX" not in path.parts
