"""Text files in a ZIP archive, which may be anybody's."""

from __future__ import annotations

import io
import re
import zipfile
from pathlib import Path

from naris.errors import KeyframeError

_MOST_FILES, _MOST_BYTES = 10_000, 16 << 20


def texts_in(archive: bytes, ending: str) -> list[tuple[str, bytes]]:
    """Names, without folders, and contents of the files with an ending, 9 before 10.

    Raises:
        KeyframeError: if it is no archive, or holds none, too many or too large ones.
    """
    expected = f"a ZIP archive of {ending} files of the original"
    try:
        with zipfile.ZipFile(io.BytesIO(archive)) as whole:
            entries = [one for one in whole.infolist() if one.filename.lower().endswith(ending)]
            if not entries:
                raise KeyframeError(expected, "none in it", "export them again")
            if len(entries) > _MOST_FILES or sum(one.file_size for one in entries) > _MOST_BYTES:
                raise KeyframeError(
                    f"at most {_MOST_FILES} files of {_MOST_BYTES >> 20} MB together", "more", "give fewer"
                )
            entries.sort(key=lambda one: re.sub(r"\d+", lambda digits: digits.group().zfill(12), one.filename))
            return [(Path(one.filename).name, whole.read(one)) for one in entries]
    except (
        zipfile.BadZipFile,
        RuntimeError,
        NotImplementedError,
    ) as error:  # the latter two: locked, or packed strangely
        raise KeyframeError(expected, "something else", "export them again") from error
