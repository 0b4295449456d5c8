"""Keyframes in a real browser: changed at two places, without a server that listens, deleted and taken back."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from naris.bench.browser import missing_browser, opened, until
from naris.render.keyframes import read_keyframes
from tests.winding_tube import winding_tube

LACKS = missing_browser()
pytestmark = [pytest.mark.slow, pytest.mark.skipif(LACKS is not None, reason=f"needs {LACKS}")]
steered = winding_tube
REFUSALS = "status of 400", "status of 403"


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
        ("aBXc", "abXc", "aXcB"),  # two at one pose: known by their names as well, so that a new name is a new one
        ("abX", "aX", "aX"),
    ],
)
def test_what_either_changed_is_in_both(browser: Any, here: str, there: str, both: str) -> None:
    """Letters are names; those of one place in the alphabet, and X and Y in the second, are of one pose."""
    told = browser.execute_async_script(
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
    assert (
        browser.execute_script("return Object.keys(localStorage).filter(key => key.startsWith('naris-keyframes'))")
        == []
    )


def test_what_several_pages_left_comes_together_and_what_is_not_of_naris_is_no_harm(
    run: Callable[..., Any], browser: Any, address: str, folder: Path
) -> None:
    run(
        "const start = naris.page.start, at = (x) => [[1, 0, 0, x], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];"
        "const leave = (slot, told) => localStorage.setItem(`naris-keyframes/1 ${slot}`, JSON.stringify(told));"
        "leave(`${start.place} one`, { known: [], keyframes: [{ name: 'one', pose: at(1) }] });"
        "leave(`${start.place} two`, { known: [], keyframes: [{ name: 'two', pose: at(2) }] });"
        "leave(`${start.place} bad`, {}); leave(`${start.place} worse`, { known: [], keyframes: [{ name: 3 }] });"
        "localStorage.setItem(`naris-keyframes/1 ${start.place} none`, '{');"
        "leave('another-place one', { known: [], keyframes: [{ name: 'another', pose: at(3) }] });"
    )
    opened(browser, address)
    until(lambda: sorted(names(folder)) == ["one", "two"])
    until(lambda: browser.execute_script("return !naris.page.strip.unsaved && !naris.page.strip.isSaving"))
    left = browser.execute_script("return Object.keys(localStorage).filter(key => / (one|two)$/.test(key))")
    assert left == ["naris-keyframes/1 another-place one"]


def test_a_full_store_of_the_browser_keeps_nothing_from_being_saved(run: Callable[..., Any], folder: Path) -> None:
    run("window.kept = Storage.prototype.setItem; Storage.prototype.setItem = () => { throw new Error('full'); }")
    try:
        saved(run, 1)
        until(lambda: names(folder) == ["00"])
    finally:
        run("Storage.prototype.setItem = window.kept")


def test_a_page_of_another_file_writes_nothing_into_this_one(run: Callable[..., Any], folder: Path) -> None:
    run("naris.page.start.place = naris.page.strip.host.place = 'another'")
    saved(run, 1)
    until(lambda: run("return naris.page.strip.unsaved && !naris.page.strip.isSaving"))
    assert names(folder) == []
    until(lambda: "load the page again" in run("return document.getElementById('message').textContent"))


def test_what_is_typed_stays_when_the_strip_is_drawn_anew(run: Callable[..., Any], browser: Any) -> None:
    saved(run, 2)
    until(lambda: run("return !naris.page.strip.isSaving && !naris.page.strip.unsaved"))
    field = browser.find_elements("css selector", "#strip input")[0]
    field.send_keys("abc")
    run("naris.page.strip.save()")
    assert run("return document.activeElement.value") == "00abc"


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


def test_a_list_can_be_gone_through_with_keys(run: Callable[..., Any], browser: Any) -> None:
    from selenium.webdriver.common.keys import Keys

    before = run("const list = document.getElementById('optics'); list.focus(); return list.value")
    browser.find_element("id", "optics").send_keys(Keys.ARROW_DOWN, Keys.ARROW_DOWN)
    assert run("return [document.activeElement.id, document.getElementById('optics').value]") == ["optics", "45"]
    run("const list = document.getElementById('optics'); list.dispatchEvent(new PointerEvent('pointerdown'));"
        "list.value = arguments[0]; list.dispatchEvent(new Event('change'))", before)  # fmt: skip
    assert run("return document.activeElement.id") == "inside-canvas"


def test_two_fingers_outside_come_nearer_and_paint_nothing(run: Callable[..., Any], browser: Any) -> None:
    x, y = run("const box = document.getElementById('outside-canvas').getBoundingClientRect();"
               "return [box.x + box.width / 2, box.y + box.height / 2]")  # fmt: skip
    run("naris.page.strip.host.back(); document.getElementById('brush').click()")
    try:
        reach, turn = run("return [naris.page.outside.reach, naris.page.outside.turn.slice()]")
        for kind, apart in (("touchStart", 0), ("touchStart", 20), ("touchMove", 40), ("touchEnd", None)):
            points = [] if apart is None else [{"x": x, "y": y, "id": 0}]
            if apart:
                points.append({"x": x + apart, "y": y, "id": 1})
            browser.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
        assert run("return naris.page.outside.reach") == pytest.approx(reach / 2, rel=0.05)
        assert run("return naris.page.outside.turn") == turn
        assert run("return [naris.page.brush.waiting.length, naris.page.brush.stroke, naris.page.brush.strokes]") == [
            0, None, 0
        ]  # fmt: skip
    finally:
        run("document.getElementById('brush').click()")


def test_a_mouse_outside_leaves_the_keys_with_the_scope(run: Callable[..., Any], browser: Any) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    run("document.getElementById('fov').focus()")
    ActionChains(browser).drag_and_drop_by_offset(browser.find_element("id", "outside-canvas"), 40, 0).perform()
    assert run("return document.activeElement.id") == "inside-canvas"


def test_a_ring_shows_how_far_the_brush_reaches_where_there_is_a_wall(run: Callable[..., Any], browser: Any) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    width = "const ring = document.getElementById('ring'); return ring.hidden ? null : parseFloat(ring.style.width)"
    ActionChains(browser).move_to_element(browser.find_element("id", "inside-canvas")).perform()
    assert run(width) is None
    run("document.getElementById('brush').click()")
    try:
        ActionChains(browser).move_by_offset(20, 10).perform()
        narrow = run(width)
        run("const radius = document.getElementById('brush-radius'); radius.value = 6;"
            "radius.dispatchEvent(new Event('input'))")  # fmt: skip
        assert run(width) == pytest.approx(2 * narrow, rel=1e-3)
        run("const p = naris.page.start.pose.map(row => [...row]); p[0][3] += 5000; naris.go(p)")
        ActionChains(browser).move_by_offset(5, 5).perform()
        assert run(width) is None  # nothing is there
    finally:
        run("document.getElementById('brush').click(); naris.go(naris.page.start.pose)")


def test_what_was_typed_gives_the_keys_back_with_enter_or_escape(run: Callable[..., Any], browser: Any) -> None:
    from selenium.webdriver.common.keys import Keys

    saved(run, 1)
    field = browser.find_element("css selector", "#strip input")
    field.send_keys("x", Keys.ENTER)
    until(lambda: run("return document.activeElement.id") == "inside-canvas")
    assert run("return naris.page.strip.keyframes[0].name") == "00x"
    browser.find_element("id", "optics").send_keys(Keys.ESCAPE)
    until(lambda: run("return document.activeElement.id") == "inside-canvas")


def test_all_that_is_refused_of_several_files_is_told(run: Callable[..., Any], browser: Any) -> None:
    told = browser.execute_async_script(
        "const done = arguments[arguments.length - 1], file = (name, text) => new File([text], name);"
        "const files = [file('bad.txt', 'no pose'), file('worse.zip', 'none'), file('good.txt', '0,0,1\\n0,0,1\\n')];"
        "naris.page.strip.saved().then(() => naris.takeAll(files))"
        ".then(() => done(document.getElementById('message').textContent))"
    )
    assert "bad.txt: expected" in told and "worse.zip: expected" in told
