"""The page in a real browser: it opens without errors or requests, plays, and fits a phone."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from pm01_nav.report.build import write_report

pytestmark = pytest.mark.browser
ARGUMENTS = (
    *("--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run"),
    *("--disable-background-networking", "--disable-component-update", "--disable-sync"),
)
PHONE, DESK = {"width": 390, "height": 844}, {"width": 1280, "height": 900}
HOSTILE = "</script><img src=x onerror=alert(1)>"


@pytest.fixture(scope="module")
def browser():
    playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright")
    with playwright.sync_playwright() as started:
        names = ("chromium", "chromium-browser", "google-chrome")
        own = started.chromium.executable_path
        path = own if Path(own).exists() else next(filter(None, map(shutil.which, names)), None)
        if path is None:
            pytest.skip("needs Chromium: `playwright install chromium`, or one on PATH")
        launched = started.chromium.launch(executable_path=path, args=list(ARGUMENTS))
        yield launched
        launched.close()


@pytest.fixture
def report(results):
    """Two entries, a sweep and three replays."""
    folder = results("static", "good", [True] * 4, traces=[0, 2])
    results("static", "bad", [False] * 4, traces=[0], reason=HOSTILE)
    for value in (0.0, 8.0):
        sweep = {"sweep": "density", "label": "obstacles", "suite": "static", "value": value}
        results(f"static@{value:g}", "good", [True] * 4, sweep=sweep)
    return write_report([folder])


@pytest.fixture
def visit(browser, report):
    """A function that opens the report; afterwards nothing may have been complained of."""
    complaints, contexts = [], []

    def opened(address="", scheme="light", viewport=DESK):
        context = browser.new_context(color_scheme=scheme, viewport=viewport)
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda message: complaints.append(message.text))
        page.on("pageerror", lambda error: complaints.append(str(error)))
        page.on("request", lambda request: complaints.append(request.url))
        page.goto(report.as_uri() + address)
        # The page itself is the one thing that is asked for.
        assert [entry.partition("#")[0] for entry in complaints] == [report.as_uri()]
        complaints.clear()
        return page

    yield opened
    for context in contexts:
        context.close()
    assert complaints == []


def wait(page, condition):
    """Wait until a JavaScript expression is true; Playwright's own way needs what the page's
    policy forbids."""
    for _ in range(200):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(25)
    pytest.fail(f"never came true: {condition}")


def wait_open(page):
    wait(page, "Boolean(window.pm01Player.state) && document.querySelector('#player').open")


def pixels(page):
    """Return the picture of the world as a string."""
    return page.evaluate("document.querySelector('[data-part=world]').toDataURL()")


def background(page):
    return page.evaluate("getComputedStyle(document.body).backgroundColor")


def test_light_and_dark(visit):
    light, dark = visit(), visit(scheme="dark")
    assert background(light) == "rgb(255, 255, 255)"
    # Dark: every channel below a quarter of 255.
    channels = background(dark).removeprefix("rgb(").removesuffix(")").split(",")
    assert max(int(channel) for channel in channels) < 64
    light.click("#theme")
    assert background(light) == background(dark)
    assert light.text_content("#theme") == "Light"


def test_a_replay_plays(visit):
    page = visit()
    page.click("a[data-key='static/good/0']")
    wait_open(page)
    wait(page, "window.pm01Player.time > 0.3")
    assert page.evaluate("window.pm01Player.playing")
    page.keyboard.press("Space")
    assert not page.evaluate("window.pm01Player.playing")
    assert page.evaluate("location.hash") == "#static/good/0"
    page.keyboard.press("Escape")
    wait(page, "!document.querySelector('#player').open")
    assert page.evaluate("location.hash") == ""


def test_the_scrubber_moves_the_robot(visit):
    """The robot drives from x = 1 m to 3 m in 20 steps of 0.1 s; after 1 s it is at 2 m."""
    page = visit("#static/good/2")
    wait_open(page)
    page.keyboard.press("Home")
    before = pixels(page)
    assert page.evaluate("window.pm01Player.state.x") == pytest.approx(1.0, abs=0.002)
    page.locator("[data-part=scrub]").fill("1")
    assert page.evaluate("window.pm01Player.state.x") == pytest.approx(2.0, abs=0.002)
    assert page.evaluate("window.pm01Player.state.yaw") == pytest.approx(0.0, abs=0.002)
    # Clearance falls evenly from 0.9 m to 0.1 m, and the rewards of ten steps are -0.05 each.
    assert page.text_content("[data-part=clearance-legend] b") == "0.50"
    assert page.text_content("[data-part=reward-legend] b") == "\N{MINUS SIGN}0.50"
    assert pixels(page) != before
    page.keyboard.press("ArrowRight")
    assert page.evaluate("window.pm01Player.time") == pytest.approx(1.1, abs=0.001)


def test_deep_link(visit):
    page = visit("#static/bad/0")
    wait_open(page)
    assert page.text_content("[data-part=title]") == "bad on static"
    assert page.text_content("[data-part=outcome]") == "collision"
    assert page.text_content("[data-part=reason]") == HOSTILE
    page.keyboard.press("p")
    wait(page, "window.pm01Player.key.startsWith('static/good/')")


def test_a_table_is_sorted(visit):
    page = visit()
    names = "[...document.querySelectorAll('#overview tbody th')].map((cell) => cell.textContent)"
    assert page.evaluate(names) == ["good", "bad"]
    header = page.locator("#overview thead button").nth(1)
    header.click()
    assert page.evaluate(names) == ["good", "bad"]
    header.click()
    assert page.evaluate(names) == ["bad", "good"]


@pytest.mark.parametrize("address", ["", "#static/good/0"])
def test_a_phone_does_not_scroll_sideways(visit, address):
    page = visit(address, viewport=PHONE)
    if address:
        wait_open(page)
        wider = "(dialog) => dialog.scrollWidth - dialog.clientWidth"
        assert page.eval_on_selector("#player", wider) == 0
    assert page.evaluate("document.documentElement.scrollWidth") == 390
