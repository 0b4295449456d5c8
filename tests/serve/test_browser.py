"""The page in a real browser: it flies as one expects, walls hold, and it shows what our renderer shows."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import brentq
from skimage.metrics import structural_similarity

from naris.bench.browser import chromium, missing_browser, opened, shown, sized, until
from naris.core.camera import Brown, Intrinsics
from naris.core.pose import CAMERA, Pose
from naris.dataset.read import Dataset
from naris.render.keyframes import read_keyframes
from naris.render.scene import Scene, render
from naris.serve.stage import steady
from tests import simulated_head

TURNS = ["ArrowUp", "ArrowDown", "ArrowLeft", "ArrowRight", "KeyQ", "KeyE"]
MOVES = ["KeyW", "KeyS", "KeyA", "KeyD", "PageUp", "PageDown"]

LACKS = missing_browser()
pytestmark = [pytest.mark.slow, pytest.mark.skipif(LACKS is not None, reason=f"needs {LACKS}")]
steered = simulated_head.nose


@pytest.fixture
def run(browser: Any) -> Callable[..., Any]:
    """A script in the page, at its start with nothing pressed and no loop of its own that moves."""
    browser.execute_script(
        "naris.state.paused = true;"  # a graphics card in software takes long, and nothing here looks at its pictures
        "naris.page.keys.releaseAll(); naris.state.flying = null; naris.go(naris.page.start.pose)"
    )
    return browser.execute_script


def alike(a: np.ndarray, b: np.ndarray) -> float:
    return float(structural_similarity(a, b, channel_axis=2))


@pytest.mark.parametrize(
    ("key", "axis", "sign"),
    [("ArrowRight", 0, -1), ("ArrowLeft", 0, 1), ("ArrowUp", 1, 1), ("ArrowDown", 1, -1),
     ("KeyD", 0, -1), ("KeyA", 0, 1), ("PageUp", 1, 1), ("PageDown", 1, -1)],
)  # fmt: skip
def test_what_lies_ahead_goes_the_other_way(run: Callable[..., Any], key: str, axis: int, sign: int) -> None:
    """Steering right moves a landmark left in the picture: x is right, y is down."""
    point = run("const p = naris.pose(); return [0, 1, 2].map(i => p[i][3] + 6 * p[i][2])")
    before, after = run(
        "const before = naris.project(arguments[0]); naris.page.keys.press(arguments[1]); naris.step(0.05);"
        "naris.page.keys.release(arguments[1]); return [before, naris.project(arguments[0])]", point, key,
    )  # fmt: skip
    assert np.allclose(before, 0, atol=1e-9)
    assert sign * after[axis] > 0.004
    assert abs(after[1 - axis]) < 1e-3


def test_in_and_out_go_along_the_shaft_and_come_back(run: Callable[..., Any]) -> None:
    way = run(
        "const at = () => naris.pose().slice(0, 3).map(r => r[3]), p = naris.pose(), far = [];"
        "for (const key of ['KeyW', 'KeyS']) { const a = at(); naris.page.keys.press(key); naris.step(0.1);"
        "naris.page.keys.release(key); const b = at();"
        "far.push([0, 1, 2].reduce((q, i) => q + (b[i] - a[i]) * p[i][2], 0)); } return far"
    )
    speed = run("return naris.page.flight.speed")
    assert way[0] == pytest.approx(0.1 * speed, rel=0.2)
    assert way[1] == pytest.approx(-way[0], rel=0.2)


def test_angled_optics_look_aside_and_stand_still(run: Callable[..., Any]) -> None:
    straight = np.array(run("return naris.pose()"))
    for angle, post in ((30, 0), (45, 90), (70, -120)):
        pose = np.array(
            run("naris.page.flight.setOptics(arguments[0], arguments[1]); return naris.pose()", angle, post)
        )
        run("naris.page.flight.setOptics(0, 0)")
        np.testing.assert_allclose(pose[:3, 3], straight[:3, 3])
        seen = straight[:3, :3].T @ pose[:3, 2]
        a, phi = np.deg2rad([angle, post])
        np.testing.assert_allclose(seen, [np.sin(a) * np.sin(phi), -np.sin(a) * np.cos(phi), np.cos(a)], atol=1e-9)


def test_ten_thousand_keys_do_not_lead_through_a_wall(run: Callable[..., Any]) -> None:
    least, far, straight = run(
        """const keys = arguments[0], flight = naris.page.flight, begun = flight.position;
        let seed = 7, least = 99, far = 0;
        const random = (n) => (seed = (seed * 1103515245 + 12345) % 2147483648) % n;
        for (let i = 0; i < 10000; i++) {
          const key = keys[random(keys.length)];
          naris.page.keys.press(key, random(3) === 0);
          naris.step(0.05 + random(10) / 100);
          naris.page.keys.release(key);
          least = Math.min(least, naris.distance());
          far = Math.max(far, Math.hypot(...flight.position.map((x, k) => x - begun[k])));
        }
        const p = naris.pose(), c = (k) => [p[0][k], p[1][k], p[2][k]];
        const dot = (a, b) => a.reduce((s, x, i) => s + x * b[i], 0);
        return [least, far, Math.max(Math.abs(dot(c(0), c(1))), Math.abs(dot(c(2), c(2)) - 1))]""",
        [*MOVES, *TURNS],
    )
    assert least > 0.3
    assert far > 5  # it went somewhere
    assert straight < 1e-9


def test_through_walls_only_when_told(run: Callable[..., Any]) -> None:
    through = (
        "naris.page.flight.throughWalls = arguments[0]; naris.page.keys.press('KeyD');"
        "for (let i = 0; i < arguments[1]; i++) naris.step(0.1);"
        "naris.page.keys.release('KeyD'); naris.page.flight.throughWalls = false; return naris.distance()"
    )
    assert run(through, False, 100) > 0.3
    assert run(through, True, 40) <= -1.0
    back = run(through.replace("KeyD", "KeyA"), False, 80)
    assert back > 0  # it is not stuck in there


def test_the_page_shows_what_our_renderer_does(run: Callable[..., Any], browser: Any) -> None:
    nose = simulated_head.nose()
    scene, camera = Scene(nose), Intrinsics.from_vertical_fov(200, 200, 70.0)
    places = run("return naris.page.about.places.map(p => p.pose)")
    for matrix in places[:: len(places) // 4]:
        pose = Pose(np.array([matrix]), nose.frame, CAMERA)
        ours = render(scene, pose, camera, steady(), want=("rgb",)).rgb
        assert ours is not None
        assert alike(shown(browser, matrix, 70.0, 200), ours[0]) > 0.98


@pytest.mark.parametrize("shape", [(200, 200), (266, 150)])
def test_a_lens_that_bends_shows_what_our_renderer_does_with_it(
    run: Callable[..., Any], browser: Any, shape: tuple[int, int]
) -> None:
    nose = simulated_head.nose()
    width, height = shape
    barrel, fov_deg = 0.1, 75.0
    up, corner = np.tan(np.deg2rad(fov_deg / 2)), 1 + max(width / height, 4 / 3) ** 2
    # k1 is such that at the corner, as it is bent, k1·r² = −barrel; of 4:3 where the picture is narrower.
    k1 = brentq(lambda k: -k * corner * (up * (1 + k * up * up)) ** 2 - barrel, -0.2 / up**2, 0)
    camera = Intrinsics.from_vertical_fov(width, height, fov_deg, Brown(k1))
    matrix = run("return naris.page.about.places[1].pose")
    ours = render(Scene(nose), Pose(np.array([matrix]), nose.frame, CAMERA), camera, steady(), want=("rgb",)).rgb
    assert ours is not None
    try:
        run(f"naris.page.inside.barrel = {barrel}")
        told = run(f"return naris.lens({barrel}, {fov_deg}, {width / height}).k1")
        bent = shown(browser, matrix, fov_deg, width, height)
    finally:
        run("naris.page.inside.barrel = 0")
    assert told == pytest.approx(k1, rel=1e-6)
    straight = shown(browser, matrix, fov_deg, width, height)
    assert alike(bent, ours[0]) > 0.97 > alike(straight, ours[0]) + 0.02  # it is the lens that makes them alike


def test_a_click_on_a_region_arrives_in_it(run: Callable[..., Any], browser: Any) -> None:
    for number in (2, 3):
        run(f"document.querySelectorAll('#regions button')[{number}].click()")
        until(lambda: browser.execute_script("return naris.state.flying === null"))
        assert browser.execute_script("return naris.region()") == number
    until(lambda: browser.execute_script("return naris.page.flight.undo()"))
    assert browser.execute_script("return naris.region()") == 2


def test_a_drag_in_the_brush_paints_the_wall_and_turns_nothing(
    run: Callable[..., Any], browser: Any, folder: Path
) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    browser.find_element("id", "brush").click()
    number, names = run("return [naris.region(), naris.page.about.regions.map(r => r.name)]")
    other = (number + 1) % len(names)
    run(f"document.querySelector('#brush-region').value = {other};"
        "document.querySelector('#brush-region').dispatchEvent(new Event('change'));")  # fmt: skip
    before = browser.execute_script("return naris.pose()")
    painted = f"Array.from(naris.page.surface.arrays.region).filter(r => r === {other}).length"
    was = browser.execute_script(f"return {painted}")
    assert was > 0
    canvas = browser.find_element("id", "inside-canvas")
    drag = ActionChains(browser).move_to_element(canvas).click_and_hold().move_by_offset(30, 10)
    drag.perform()
    # It is shown while it is made, before anybody is asked.
    shown_now = f"[...naris.page.inside.mesh.geometry.getAttribute('region').array].filter(r => r === {other}).length"
    assert browser.execute_script(f"return {shown_now}") > was
    assert browser.execute_script("return naris.state.strokes > naris.state.strokesDrawn")
    assert browser.execute_script(f"return {painted}") == was
    ActionChains(browser).release().perform()
    until(lambda: browser.execute_script(f"return {painted}") > was)
    np.testing.assert_allclose(browser.execute_script("return naris.pose()"), before, atol=1e-9)
    browser.find_element("id", "brush-save").click()
    until(lambda: (folder / "regions-1.json").exists())
    more = browser.execute_script(f"return {painted}")
    browser.find_element("id", "brush-undo").click()
    until(lambda: browser.execute_script(f"return {painted}") < more)
    back = browser.execute_script(f"return {painted}")
    outside = browser.find_element("id", "outside-canvas")
    turned = browser.execute_script("return [...naris.page.outside.turn]")
    ActionChains(browser).move_to_element(outside).click_and_hold().move_by_offset(12, 0).release().perform()
    until(lambda: browser.execute_script(f"return {painted}") != back)
    assert browser.execute_script("return [...naris.page.outside.turn]") == turned
    browser.find_element("id", "brush-undo").click()
    until(lambda: browser.execute_script(f"return {painted}") == back)
    browser.find_element("id", "brush").click()
    ActionChains(browser).move_to_element(outside).click_and_hold().move_by_offset(12, 0).release().perform()
    assert browser.execute_script("return naris.page.outside.turn[0]") != turned[0]


def _finger(browser: Any, kind: str, *points: tuple[float, float]) -> None:
    touched = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(points)]
    browser.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": touched})


@pytest.fixture
def middle(run: Callable[..., Any]) -> tuple[float, float]:
    """Of what the scope sees, in the page."""
    x, y = run(
        "const box = document.getElementById('inside-canvas').getBoundingClientRect();"
        "return [box.x + box.width / 2, box.y + box.height / 2]"
    )
    return x, y


def _ahead(run: Callable[..., Any]) -> list[float]:
    return list(run("const p = naris.pose(); return [0, 1, 2].map(i => p[i][3] + 6 * p[i][2])"))


def test_the_roll_is_told_from_upright(run: Callable[..., Any]) -> None:
    level = Pose.look(np.zeros(3), np.array([0.0, -1, 0]), np.array([0.0, 0, 1]), "LPS")
    for turned in (0.0, 30.0, -120.0):
        pose = level @ Pose.exp(np.array([0, 0, 0, 0, 0, np.deg2rad(turned)]), CAMERA, CAMERA)
        run("naris.go(arguments[0])", pose.matrix.reshape(4, 4).tolist())
        assert run("return naris.roll()") == pytest.approx(turned, abs=1e-6)
    down = Pose.look(np.zeros(3), np.array([0.0, 0, -1]), np.array([0.0, 1, 0]), "LPS")
    run("naris.go(arguments[0])", down.matrix.reshape(4, 4).tolist())
    assert run("return naris.roll()") is None


@pytest.mark.parametrize("by", ["mouse", "finger"])
def test_a_drag_takes_what_is_seen_along(
    run: Callable[..., Any], browser: Any, middle: tuple[float, float], by: str
) -> None:
    """To the right and down by 30 and 20 pixels: so does what lay in the middle, and nothing is clicked."""
    point, place = _ahead(run), run("return naris.pose().map(row => row[3])")
    x, y = middle
    if by == "finger":
        _finger(browser, "touchStart", (x, y))
        for k in range(1, 6):
            _finger(browser, "touchMove", (x + 6 * k, y + 4 * k))
        _finger(browser, "touchEnd")
    else:
        for kind, k in [("mousePressed", 0), *(("mouseMoved", k) for k in range(1, 6)), ("mouseReleased", 5)]:
            browser.execute_cdp_cmd(
                "Input.dispatchMouseEvent",
                {"type": kind, "x": x + 6 * k, "y": y + 4 * k, "button": "left", "buttons": 1, "clickCount": 1},
            )
    until(lambda: run("return naris.project(arguments[0])[0]", point) > 0.05)
    right, down = run("return naris.project(arguments[0])", point)
    assert right == pytest.approx(1.5 * down, rel=0.05)
    assert run("return naris.pose().map(row => row[3])") == pytest.approx(place)


def test_two_fingers_that_spread_insert_and_that_close_withdraw(
    run: Callable[..., Any], browser: Any, middle: tuple[float, float]
) -> None:
    x, y = middle
    ways = []
    for apart in ([40, 60, 80], [80, 60, 40]):
        before = run("return naris.page.flight.inserted")
        _finger(browser, "touchStart", (x - apart[0], y), (x + apart[0], y))
        for one in apart[1:]:
            _finger(browser, "touchMove", (x - one, y), (x + one, y))
        _finger(browser, "touchEnd")
        ways.append(run("return naris.page.flight.inserted") - before)
    assert ways[0] > 1 and ways[1] < -1
    assert ways[0] == pytest.approx(0.05 * 80, rel=0.3)  # walls may stop it a little before


def test_a_wheel_inserts_when_it_is_turned_away(
    run: Callable[..., Any], browser: Any, middle: tuple[float, float]
) -> None:
    x, y = middle
    for turned, sign in ((-100, 1), (100, -1)):
        before = run("return naris.page.flight.inserted")
        browser.execute_cdp_cmd(
            "Input.dispatchMouseEvent", {"type": "mouseWheel", "x": x, "y": y, "deltaX": 0, "deltaY": turned}
        )
        until(lambda: run("return naris.page.flight.inserted") != before)  # noqa: B023
        assert run("return naris.page.flight.inserted") - before == pytest.approx(sign * 0.6, rel=0.3)


@pytest.mark.parametrize(("stick", "axis", "sign"), [(0, 0, -1), (2, 0, -1), (3, 1, -1)])
def test_a_gamepad_steers_as_its_sticks_point(run: Callable[..., Any], stick: int, axis: int, sign: int) -> None:
    """A browser without one is told of one: what its sticks say, the scope does."""
    point = _ahead(run)
    after = run(
        "const axes = [0, 0, 0, 0]; axes[arguments[1]] = 0.9;"
        "const real = navigator.getGamepads;"
        "navigator.getGamepads = () => [null, { connected: true, axes, buttons: [] }];"
        "try { naris.step(0.1); } finally { navigator.getGamepads = real; }"
        "return naris.project(arguments[0])", point, stick,
    )  # fmt: skip
    assert sign * after[axis] > 0.004
    assert abs(after[1 - axis]) < 1e-3


def test_a_gamepad_inserts_rolls_and_rests(run: Callable[..., Any]) -> None:
    inserted, rolled, still = run(
        "const real = navigator.getGamepads, flight = naris.page.flight;"
        "const told = (axes, pressed = []) => { navigator.getGamepads = () => [{ connected: true, axes,"
        "  buttons: [...Array(8).keys()].map(k => ({ value: pressed.includes(k) ? 1 : 0 })) }]; naris.step(0.1); };"
        "try { told([0, -1, 0, 0]); const inserted = flight.inserted; const a = naris.pose();"
        "  told([0.1, -0.1, 0.1, 0.1]); const still = JSON.stringify(naris.pose()) === JSON.stringify(a);"
        "  told([0, 0, 0, 0], [5]); const b = naris.pose();"
        "  return [inserted, [0, 1, 2].reduce((sum, i) => sum + b[i][0] * a[i][1], 0), still];"
        "} finally { navigator.getGamepads = real; }"
    )
    assert inserted > 0.1
    assert rolled == pytest.approx(np.sin(np.deg2rad(4.5)))  # 45°/s, clockwise: x towards y
    assert still  # sticks never rest quite at 0


def test_the_outside_view_has_keys_of_its_own(run: Callable[..., Any], browser: Any) -> None:
    from selenium.webdriver.common.keys import Keys

    canvas = browser.find_element("id", "outside-canvas")
    before = run("return [naris.pose(), naris.page.outside.turn.slice(), naris.page.outside.reach]")
    canvas.send_keys(Keys.ARROW_RIGHT, Keys.ARROW_DOWN, "+")
    after = run("return [naris.pose(), naris.page.outside.turn, naris.page.outside.reach]")
    assert after[0] == before[0]
    assert np.subtract(after[1], before[1]) == pytest.approx([0.1, 0.1])
    assert after[2] == pytest.approx(before[2] / 1.1)


def test_keyframes_survive_a_reload_and_their_pictures_are_those_of_simulate(
    run: Callable[..., Any], browser: Any, address: str, folder: Path
) -> None:
    from selenium.webdriver.common.action_chains import ActionChains

    line = simulated_head.nose().passages[0].points_mm
    start = len(line) // 3
    poses = Pose.look(
        line[[start, start + 6]], line[[start + 8, start + 14]] - line[[start, start + 6]], np.array([0.0, 0, 1]), "LPS"
    )
    for pose in poses.matrix:
        run("naris.go(arguments[0]); document.getElementById('inside-canvas').focus()", pose.tolist())
        ActionChains(browser).send_keys("c").perform()
    until(lambda: (folder / "keyframes.json").exists() and len(read_keyframes(folder / "keyframes.json")) == 2)
    np.testing.assert_allclose(
        read_keyframes(folder / "keyframes.json").anatomy_T_camera.matrix, poses.matrix, atol=1e-6
    )
    opened(browser, address)
    browser.execute_script("naris.state.paused = true")
    until(lambda: browser.execute_script("return document.querySelectorAll('#strip li').length") == 2)
    pictures = "return [...document.querySelectorAll('#strip img')].map(one => one.naturalWidth)"
    until(lambda: browser.execute_script(pictures) == [192, 192])
    browser.execute_script(
        "const set = (id, value) => { const one = document.getElementById(id); one.value = value;"
        "one.dispatchEvent(new Event('input')); };"
        "set('fov', 66); set('barrel', 8); set('per-position', 1); document.getElementById('simulate').click()"
    )
    until(lambda: "pictures in" in browser.execute_script("return document.getElementById('simulated').textContent"))
    dataset = Dataset.open(folder / "keyframes-pictures")
    assert len(dataset) >= 3
    for i in (0, len(dataset) - 1):
        pose = dataset.anatomy_T_camera[i].matrix.tolist()
        page = shown(browser, pose, 66.0, dataset.intrinsics.height)
        assert alike(page, dataset.images([i])[0]) > 0.9
    browser.execute_script("document.getElementById('barrel').value = 0;"
                           "document.getElementById('barrel').dispatchEvent(new Event('input'))")  # fmt: skip
    straight = shown(browser, pose, 66.0, dataset.intrinsics.height)
    assert alike(straight, dataset.images([i])[0]) < alike(page, dataset.images([i])[0]) - 0.02


def test_what_is_saved_without_a_connection_is_kept_when_there_is_one(
    run: Callable[..., Any], browser: Any, folder: Path
) -> None:
    def is_connected(value: bool) -> None:
        conditions = {"offline": not value, "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1}
        browser.execute_cdp_cmd("Network.emulateNetworkConditions", conditions)

    def count() -> int:
        path = folder / "keyframes.json"
        return len(read_keyframes(path)) if path.exists() else 0

    before, lost = count(), "return !document.getElementById('lost').hidden"
    browser.execute_cdp_cmd("Network.enable", {})
    is_connected(False)
    run("document.getElementById('save').click()")
    run("document.getElementById('save').click()")
    until(lambda: browser.execute_script(lost))
    assert count() == before
    is_connected(True)
    until(lambda: count() == before + 2)
    until(lambda: not browser.execute_script(lost))
    browser.get_log("browser")  # requests that failed, as they had to


def test_every_control_has_a_name_and_nothing_sticks_out(run: Callable[..., Any], browser: Any) -> None:
    for width, height in ((1280, 720), (3840, 2160)):
        sized(browser, width, height)
        told = run(
            """const page = document.documentElement;
            const named = (e) => e.getAttribute('aria-label') || e.textContent.trim() || e.labels?.length;
            const nameless = [...document.querySelectorAll('button, input, select, canvas, a')].filter(
              (e) => !e.hidden && !named(e));
            return {over: page.scrollWidth - innerWidth, tall: page.scrollHeight - innerHeight,
              nameless: nameless.map((e) => e.id)}"""
        )
        assert told == {"over": 0, "tall": 0, "nameless": []}, width
    sized(browser, 1020, 600)


def test_without_webgl_the_page_says_so(address: str) -> None:
    with chromium(more=["--disable-3d-apis"]) as driver:
        driver.get(address)
        until(lambda: "no WebGL 2" in driver.execute_script("return document.getElementById('here').textContent"))
