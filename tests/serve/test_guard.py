"""Nobody gets in without the token, from another origin or under another name; and the page may load nothing else."""

from __future__ import annotations

import pytest
from fastapi.testclient import TestClient

from naris.serve.app import STATIC
from tests.serve.conftest import PORT, TOKEN


@pytest.mark.parametrize("address", ["/", "/?token=", "/?token=another", "/?token=a-tokem", "/api/start", "/steer.js"])
def test_without_the_token_nothing_is_told(stranger: TestClient, address: str) -> None:
    answer = stranger.get(address, follow_redirects=False)
    assert answer.status_code == 403
    assert "with its token" in answer.text


def test_the_token_leaves_the_address_for_a_cookie_that_scripts_cannot_read(stranger: TestClient) -> None:
    answer = stranger.get(f"/?token={TOKEN}", follow_redirects=False)
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    cookie = answer.headers["set-cookie"]
    assert "HttpOnly" in cookie and "SameSite=Strict" in cookie
    assert stranger.get("/").status_code == 200


@pytest.mark.parametrize(
    "headers",
    [
        {"origin": "http://example.com"},
        {"origin": "null"},
        {"origin": f"http://127.0.0.1:{PORT + 1}"},
        {"origin": f"https://127.0.0.1:{PORT}"},
        {"host": "example.com"},
        {"host": f"example.com:{PORT}"},
        {"host": "127.0.0.1"},
        {"sec-fetch-site": "same-site"},
        {"sec-fetch-site": "cross-site"},
    ],
)
@pytest.mark.parametrize("method", ["GET", "POST", "PUT"])
def test_from_elsewhere_nothing_is_told(client: TestClient, headers: dict[str, str], method: str) -> None:
    assert client.request(method, "/api/keyframes", headers=headers).status_code == 403


@pytest.mark.parametrize("name", ["127.0.0.1", "localhost"])
def test_its_own_page_gets_in(client: TestClient, name: str) -> None:
    own = {"origin": f"http://{name}:{PORT}", "host": f"{name}:{PORT}"}
    assert client.get("/api/keyframes", headers=own).status_code == 200


@pytest.mark.parametrize("address", ["/", "/api/start", "/api/parcel/look", "/nothing"])
def test_every_answer_forbids_what_is_not_served_here(client: TestClient, address: str) -> None:
    headers = client.get(address).headers
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy and "script-src 'self'" in policy and "unsafe" not in policy
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["referrer-policy"] == "no-referrer"
    assert "server" not in headers


@pytest.mark.parametrize("path", sorted(STATIC))
def test_every_file_of_the_page_is_served(client: TestClient, path: str) -> None:
    answer = client.get(f"/{path}")
    assert answer.status_code == 200
    assert answer.headers["content-type"] == STATIC[path][1]
    assert "//" not in path and len(answer.content) > 100


@pytest.mark.parametrize(
    "path", ["/guard.py", "/../guard.py", "/%2e%2e/guard.py", "/vendor/", "/vendor/three.LICENSE", "/api"]
)
def test_no_other_file_is(client: TestClient, path: str) -> None:
    assert client.get(path).status_code == 404


def test_a_page_needs_nothing_from_elsewhere(client: TestClient) -> None:
    for path in STATIC:
        if not path.startswith("vendor/"):
            text = client.get(f"/{path}").text
            assert "http://" not in text and "https://" not in text, path


@pytest.mark.parametrize("other", ['prefs={"theme":"dark"}', "flag", "path=/x", "x=a b c", "=", "naris-8765"])
def test_cookies_of_other_programs_are_not_in_the_way(stranger: TestClient, other: str) -> None:
    header = {"cookie": f"{other}; naris-{PORT}={TOKEN}"}
    assert stranger.get("/api/start", headers=header).status_code == 200
    assert stranger.get("/api/start", headers={"cookie": other}).status_code == 403
