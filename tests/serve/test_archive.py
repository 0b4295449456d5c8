"""Text files in ZIP archives that may be anybody's."""

from __future__ import annotations

import io
import zipfile

import numpy as np
import pytest

from naris.errors import KeyframeError
from naris.serve.archive import texts_in


def zipped(entries: dict[str, bytes], packed: int = zipfile.ZIP_DEFLATED) -> bytes:
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w", packed) as whole:
        for name, text in entries.items():
            whole.writestr(name, text)
    return buffer.getvalue()


def test_they_come_in_the_order_of_their_numbers_without_folders_and_what_is_hidden() -> None:
    entries = {"a/10.txt": b"ten", "a/9.TXT": b"nine", "read me.md": b"", "__MACOSX/a/9.txt": b"", "a/._9.txt": b""}
    assert texts_in(zipped(entries), ".txt") == [("9.TXT", b"nine"), ("10.txt", b"ten")]


@pytest.mark.parametrize(
    ("archive", "said"),
    [
        (b"no archive", "got something else"),
        (b"", "got something else"),
        (zipped({}), "got none in it"),
        (zipped({"a.md": b""}), "got none in it"),
        (zipped({"a.txt": b"1"}, zipfile.ZIP_BZIP2), "a.txt packed in another way"),
        (zipped({"a.txt": b"1"}, zipfile.ZIP_LZMA), "a.txt packed in another way"),
        (zipped({f"{81 * 'a'}.txt": b"1"}), "names of 80 letters"),
        (zipped({"a.txt": bytes(17 << 20)}), "16 MB together"),
        (zipped({f"{k}.txt": bytes(5 << 20) for k in range(4)}), "16 MB together"),
    ],
)
def test_what_is_no_archive_of_small_texts_is_refused(archive: bytes, said: str) -> None:
    with pytest.raises(KeyframeError, match=said):
        texts_in(archive, ".txt")


def test_what_unpacks_to_more_than_it_says_is_refused() -> None:
    archive = bytearray(zipped({"a.txt": bytes(64 << 20)}))
    end = archive.rindex(b"PK\x01\x02")
    archive[end + 24 : end + 28] = (100).to_bytes(4, "little")  # the size that the directory tells
    with pytest.raises(KeyframeError):
        texts_in(bytes(archive), ".txt")


@pytest.mark.parametrize("packed", [zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED])
def test_damage_is_told_in_a_sentence(packed: int) -> None:
    """Whatever byte is another: it comes out, or is refused; nothing else happens."""
    whole, rng = zipped({"0.txt": b"1 2 3\n" * 20, "1.txt": b"4 5 6\n" * 20}, packed), np.random.default_rng(0)
    refused = 0
    for place in range(len(whole)):
        damaged = bytearray(whole)
        damaged[place] ^= int(rng.integers(1, 256))
        try:
            texts_in(bytes(damaged), ".txt")
        except KeyframeError:
            refused += 1
    assert refused > len(whole) // 4
