"""Keyframes in a real browser: changed at two places, without a server that listens, deleted and taken back."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from naris.anatomy.folder import save_anatomy
from naris.bench.browser import chromium, missing_browser, opened, steering, until
from naris.render.keyframes import read_keyframes
from tests.winding_tube import winding_tube

LACKS = missing_browser()
pytestmark = [pytest.mark.slow, pytest.mark.skipif(LACKS is not None, reason=f"needs {LACKS}")]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("kept")


@pytest.fixture(scope="module")
def address(folder: Path) -> Iterator[str]:
    save_anatomy(winding_tube(), folder / "tube")
    with steering(["tube"], folder) as (address, _):
        yield address


@pytest.fixture(scope="module")
def browser(address: str) -> Iterator[Any]:
    with chromium(1020, 600) as driver:
        opened(driver, address)
        yield driver


@pytest.fixture
def run(browser: Any, address: str, folder: Path) -> Callable[..., Any]:
    """A script in a page without keyframes."""
    browser.execute_script("localStorage.clear()")
    opened(browser, address)
    browser.execute_script(
        "naris.state.paused = true; const strip = naris.page.strip; while (strip.keyframes.length) strip.remove(0)"
    )
    until(lambda: not (folder / "keyframes.json").exists())
    return browser.execute_script


def names(folder: Path) -> list[str]:
    file = folder / "keyframes.json"
    return [one.name for one in read_keyframes(file).keyframes] if file.exists() else []


def saved(run: Callable[..., Any], count: int) -> None:
    """So many keyframes, one before the other."""
    for k in range(count):
        run("const p = naris.page.start.pose.map(r => [...r]); p[0][3] += arguments[0]; naris.go(p);"
            "naris.page.strip.save()", 0.1 * k)  # fmt: skip


@pytest.mark.parametrize(
    ("here", "there", "both"),
    [
        ("abcd", "aB", "aBd"),  # one added here, one renamed and one deleted there
        ("cab", "abce", "cabe"),  # put in order here, added to there
        ("ac", "cba", "ca"),  # deleted here, put in order there
        ("aXc", "a", "aX"),  # renamed here, deleted there: it is wanted
        ("aXc", "aYc", "aXc"),  # renamed at both: here counts
        ("ac", "aYc", "aYc"),  # deleted here, renamed there: it is wanted
        ("", "abc", ""),
        ("abc", "", ""),
    ],
)
def test_what_either_changed_is_in_both(run: Callable[..., Any], here: str, there: str, both: str) -> None:
    """Letters are names; those of one place in the alphabet, and X and Y in the second, are of one pose."""
    driver = run.__self__  # type: ignore[attr-defined]
    told = driver.execute_async_script(
        "const done = arguments[arguments.length - 1], number = (name) => name.toLowerCase().charCodeAt(0) - 96;"
        "const x = (name) => ({ X: 2, Y: 2 })[name] ?? number(name);"
        "const at = (name) => [[1, 0, 0, x(name)], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];"
        "const lists = [...arguments].slice(0, 3).map((names) => [...names].map((name) => ({ name, pose: at(name) })));"
        "import('/merge.js').then(({ merged }) => done(merged(...lists).map(({ name }) => name).join('')))",
        "abc", here, there,
    )  # fmt: skip
    assert told == both


def test_two_pages_keep_what_each_deleted_and_renamed(
    run: Callable[..., Any], browser: Any, address: str, folder: Path
) -> None:
    saved(run, 3)
    until(lambda: names(folder) == ["00", "01", "02"])
    first = browser.current_window_handle
    browser.switch_to.new_window("tab")
    opened(browser, address)
    browser.execute_script(
        "const strip = naris.page.strip; strip.remove(2); strip.rename(strip.keyframes[1], 'renamed')"
    )
    until(lambda: names(folder) == ["00", "renamed"])
    browser.close()
    browser.switch_to.window(first)
    saved(run, 1)
    until(lambda: names(folder) == ["00", "renamed", "03"])
    assert run("return naris.page.strip.keyframes.map(one => one.name)") == ["00", "renamed", "03"]


def test_what_a_server_with_another_token_refused_is_saved_once_it_is_known(
    run: Callable[..., Any], browser: Any, folder: Path
) -> None:
    cookies = browser.get_cookies()
    browser.delete_all_cookies()
    saved(run, 1)
    until(lambda: run("return naris.page.strip.unsaved && !naris.page.strip.isSaving"))
    assert names(folder) == []
    for cookie in cookies:  # as when the new address is opened in another tab
        browser.add_cookie(cookie)
    until(lambda: names(folder) == ["00"])


def test_what_was_refused_is_there_in_the_page_that_is_opened_next(
    run: Callable[..., Any], browser: Any, address: str, folder: Path
) -> None:
    browser.delete_all_cookies()
    saved(run, 2)
    until(lambda: run("return naris.page.strip.unsaved && !naris.page.strip.isSaving"))
    opened(browser, address)
    until(lambda: names(folder) == ["00", "01"])
    assert browser.execute_script("return localStorage.getItem(naris.page.strip.host.place)") is None


def test_a_keyframe_that_was_deleted_is_taken_back(run: Callable[..., Any], browser: Any, folder: Path) -> None:
    saved(run, 3)
    until(lambda: run("return !naris.page.strip.isSaving && !naris.page.strip.unsaved"))
    run("document.querySelectorAll('#strip li')[1].querySelector('[aria-label^=delete]').click()")
    until(lambda: names(folder) == ["00", "02"])
    assert run("return document.activeElement.getAttribute('aria-label')") == "go to keyframe 02"
    run("document.querySelector('#message button').click()")
    until(lambda: names(folder) == ["00", "01", "02"])
    run("document.querySelectorAll('#strip li')[1].querySelector('.later').click()")
    until(lambda: names(folder) == ["00", "02", "01"])
    assert run("return document.activeElement.getAttribute('aria-label')") == "keyframe 01 later"


def test_letters_fly_and_arrows_slide_while_a_slider_has_the_focus(run: Callable[..., Any], browser: Any) -> None:
    from selenium.webdriver.common.keys import Keys

    slider = browser.find_element("id", "fov")
    before = run("return [naris.state.fov, naris.page.flight.inserted]")
    slider.send_keys(Keys.ARROW_LEFT)
    assert run("return naris.state.fov") == before[0] - 1
    assert run("return document.activeElement.id") == "fov"
    run(
        "const pressed = (kind) => document.getElementById('fov').dispatchEvent("
        "new KeyboardEvent(kind, { code: 'KeyW', key: 'w', bubbles: true }));"
        "pressed('keydown'); naris.step(0.1); pressed('keyup')"
    )
    assert run("return naris.page.flight.inserted") != before[1]


def test_level_rolls_until_up_is_up(run: Callable[..., Any]) -> None:
    run("naris.go(naris.page.start.pose); naris.page.flight.turn([0.2, 0.3, 0.7])")
    assert abs(run("return naris.roll()")) > 10
    run("naris.page.keys.press('KeyL')")
    assert run("return naris.roll()") == pytest.approx(0.0, abs=1e-6)
