"""A viewer of a winding tube with four slabs and one passage, and a client that has its token."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fastapi.testclient import TestClient

from naris.anatomy.folder import save_anatomy
from naris.bench.browser import chromium, opened, steering
from naris.core.anatomy import Anatomy
from naris.serve.app import application
from naris.serve.guard import Guard
from naris.serve.viewer import Viewer
from tests.winding_tube import winding_tube

PORT, TOKEN = 8765, "a-token"


@pytest.fixture(scope="session")
def anatomy() -> Anatomy:
    return winding_tube()


@pytest.fixture
def viewer(anatomy: Anatomy, tmp_path: Path) -> Viewer:
    return Viewer(anatomy, anatomy.region_set(), tmp_path / "keyframes.json")


@pytest.fixture
def stranger(viewer: Viewer) -> TestClient:
    """One that has not been given the token."""
    return TestClient(Guard(application(viewer), PORT, TOKEN), base_url=f"http://127.0.0.1:{PORT}")


@pytest.fixture
def client(stranger: TestClient) -> Iterator[TestClient]:
    with stranger:
        assert stranger.get(f"/?token={TOKEN}").status_code == 200
        yield stranger


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the command runs that serves the page."""
    return tmp_path_factory.mktemp("steered")


@pytest.fixture(scope="module")
def address(folder: Path, request: pytest.FixtureRequest) -> Iterator[str]:
    """Of the page of the anatomy that the module steers through: its `steered()`."""
    save_anatomy(request.module.steered(), folder / "anatomy")
    with steering(["anatomy"], folder) as (address, _):
        yield address


@pytest.fixture(scope="module")
def browser(address: str, request: pytest.FixtureRequest) -> Iterator[Any]:
    """At that page; nothing but the refusals that the module provokes, `REFUSALS`, may be in its log in the end."""
    with chromium(1020, 600) as driver:  # a graphics card in software takes long
        opened(driver, address)
        yield driver
        wrong = [line["message"] for line in driver.get_log("browser") if line["level"] == "SEVERE"]
        refusals = getattr(request.module, "REFUSALS", ())
        assert [line for line in wrong if not any(refusal in line for refusal in refusals)] == []
