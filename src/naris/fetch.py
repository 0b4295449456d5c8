"""Downloads of public files, each with its SHA-256 pinned here: what comes is what was published, or nothing.

Files go to a cache folder (`$XDG_CACHE_HOME/naris`, by default `~/.cache/naris`) or wherever is asked. A broken
download goes on where it stopped (HTTP Range), within one call and in the next.
"""

from __future__ import annotations

import http
import http.client
import os
import time
import urllib.error
import urllib.request
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import naris
from naris.core.atomic import PART, disk_full_told
from naris.core.progress import SILENT, Advance, Progress
from naris.core.provenance import file_digest
from naris.errors import FetchError

_CHUNK = 1 << 16
_WORTH_ANOTHER_TRY = {http.HTTPStatus.REQUEST_TIMEOUT, http.HTTPStatus.TOO_MANY_REQUESTS}
_CHECK = "check the address, or name a mirror with --base-url"
_DISTRUST = "do not use that source; try again later, or name a mirror with --base-url"
_AGAIN = "check the network and run the same command again, it goes on where it stopped"


@dataclass(frozen=True)
class RemoteFile:
    """One file: where it lies below the base address, how it is called here, its SHA-256 and size in bytes."""

    remote: str
    name: str
    sha256: str
    size: int


@dataclass(frozen=True)
class Collection:
    """Files that belong together, what they are, and under which terms."""

    name: str
    title: str
    licence: str
    base_url: str
    files: tuple[RemoteFile, ...]


MEAN_NOSE = Collection(
    name="mean-nose",
    title="the mean nasal cavity of Sinha et al. 2018 and the texture of their experiment",
    licence="MIT",
    base_url=(
        "https://raw.githubusercontent.com/AyushiSinha/AutoInitialization/4642bdb57fb230639b9b7ee7f994a06cc028491a"
    ),
    files=(
        RemoteFile(
            remote="PLY/ASR.ply",
            name="ASR.ply",
            sha256="f35af2b9bcc6e323b580b4fb425a1604aacfed7443ea018362c7620b6be70c13",
            size=1_787_453,
        ),
        RemoteFile(
            remote="sampled_texture.jpg",
            name="sampled_texture.jpg",
            sha256="be6559ca18b12ee9f8d73604f07f787d222f2570080e004207904180e766f16f",
            size=7_483,
        ),
        RemoteFile(
            remote="LICENSE",
            name="LICENSE",
            sha256="1a1c839f221d0e5d3dcf902e857a8fad0c43d8c819082f08fb2131e3ad6898ab",
            size=1_069,
        ),
    ),
)
COLLECTIONS: Mapping[str, Collection] = {collection.name: collection for collection in (MEAN_NOSE,)}
"""Everything that can be fetched, by name."""


@dataclass(frozen=True)
class FetchConfig:
    """How to download.

    Attributes:
        base_url: where the files lie, e.g. a mirror; None for where they were published. http, https.
        attempts: how often a file is tried before giving up.
        timeout_s: how long a server may be silent, in s.
        pause_s: before the second attempt, in s; doubled before each further one.
    """

    base_url: str | None = None
    attempts: int = 4
    timeout_s: float = 30.0
    pause_s: float = 1.0


def cache_folder() -> Path:
    """Where downloads are kept: `$XDG_CACHE_HOME/naris`, by default `~/.cache/naris`."""
    root = os.environ.get("XDG_CACHE_HOME", "")
    return (Path(root) if Path(root).is_absolute() else Path.home() / ".cache") / "naris"


def fetch(
    collection: Collection,
    folder: Path | None = None,
    config: FetchConfig = FetchConfig(),
    progress: Progress = SILENT,
) -> tuple[Path, ...]:
    """Downloads the files that are not there yet and gives their paths, in the order of the collection.

    A file that is there with the right digest is left alone; one with a wrong digest is replaced.

    Args:
        collection: what to download.
        folder: where to; by default a folder of the collection's name in `cache_folder()`.
        config: how.
        progress: told the bytes.

    Raises:
        FetchError: if a file cannot be had, is larger than published, or has another digest.
        DiskFull: if there is no room.
    """
    folder = cache_folder() / collection.name if folder is None else folder
    base_url = (config.base_url or collection.base_url).rstrip("/")
    if not base_url.startswith(("https://", "http://")):
        raise FetchError("an address that begins with https:// or http://", repr(base_url), "give the base address")
    with disk_full_told(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with progress.task(f"fetch {collection.name}", sum(file.size for file in collection.files)) as advance:
        for file in collection.files:
            if _is(folder / file.name, file):
                advance(file.size)
            else:
                _fetch_one(file, f"{base_url}/{file.remote}", folder, config, advance)
    return tuple(folder / file.name for file in collection.files)


def _fetch_one(file: RemoteFile, url: str, folder: Path, config: FetchConfig, advance: Advance) -> None:
    part = folder / f".{file.name}{PART}"
    told = _AtMost(advance, file.size)
    problem = "no attempt"
    for attempt in range(config.attempts):
        if attempt:
            time.sleep(config.pause_s * 2 ** (attempt - 1))
        try:
            with disk_full_told(folder / file.name):
                whole = _append(url, part, file, config.timeout_s, told)
        except urllib.error.HTTPError as error:
            error.close()
            problem = f"HTTP {error.code} {error.reason}"
            if error.code == http.HTTPStatus.REQUESTED_RANGE_NOT_SATISFIABLE:
                part.unlink(missing_ok=True)
            elif error.code < 500 and error.code not in _WORTH_ANOTHER_TRY:
                raise FetchError(f"{file.name} at {url}", problem, _CHECK) from error
        except (OSError, http.client.HTTPException) as error:
            # A connection fails in many words of the operating system and of TLS; only errors of files name one.
            if isinstance(error, OSError) and error.filename is not None:
                raise
            problem = str(getattr(error, "reason", "") or error) or type(error).__name__
        else:
            problem = _trouble(part, file)
            if not problem:
                part.replace(folder / file.name)
                return
            if part.stat().st_size >= file.size:
                part.unlink()
                if whole:
                    raise FetchError(f"{file.name} with SHA-256 {file.sha256}", f"{problem} from {url}", _DISTRUST)
    raise FetchError(f"{file.name} from {url} within {config.attempts} attempts", problem, _AGAIN)


def _append(url: str, part: Path, file: RemoteFile, timeout_s: float, told: _AtMost) -> bool:
    """Brings what `part` lacks, or all from a server without ranges; tells whether one answer brought all of it.

    A connection that ends early is no error here: `part` is then short.
    """
    have = part.stat().st_size if part.exists() else 0
    if have >= file.size:
        return False
    headers = {"User-Agent": f"naris/{naris.__version__}", "Accept-Encoding": "identity"}
    if have:
        headers["Range"] = f"bytes={have}-"
    request = urllib.request.Request(url, headers=headers)  # noqa: S310  # http and https only, see `fetch`
    with urllib.request.urlopen(request, timeout=timeout_s) as answer:  # noqa: S310
        goes_on = answer.status == 206 and answer.headers.get("Content-Range", "").startswith(f"bytes {have}-")
        have = have if goes_on else 0
        length = answer.headers.get("Content-Length", "")
        if length.isdigit() and have + int(length) > file.size:
            _refuse_size(file, url, have + int(length), part)
        with part.open("ab" if goes_on else "wb") as out:
            told.reach(have)
            while block := answer.read1(_CHUNK):
                have += len(block)
                if have > file.size:
                    _refuse_size(file, url, have, part)
                out.write(block)
                told.reach(have)
            out.flush()
            os.fsync(out.fileno())
    return not goes_on


def _refuse_size(file: RemoteFile, url: str, size: int, part: Path) -> None:
    part.unlink(missing_ok=True)
    raise FetchError(f"{file.size} bytes for {file.name} from {url}", f"{size} or more", _CHECK)


def _is(path: Path, file: RemoteFile) -> bool:
    return path.is_file() and not _trouble(path, file)


def _trouble(path: Path, file: RemoteFile) -> str:
    """What is wrong with a file; empty if it is what was published."""
    size = path.stat().st_size
    if size != file.size:
        return f"{size} of {file.size} bytes"
    came = file_digest(path)
    return "" if came == file.sha256 else came


class _AtMost:
    """Tells progress how far one file is; starting over does not count twice."""

    def __init__(self, advance: Callable[[int], None], size: int) -> None:
        self._advance, self._size, self._reached = advance, size, 0

    def reach(self, count: int) -> None:
        count = min(count, self._size)
        if count > self._reached:
            self._advance(count - self._reached)
            self._reached = count
