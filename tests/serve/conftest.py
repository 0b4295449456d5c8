"""A viewer of a winding tube with four slabs and one passage, and a client that has its token."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

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
