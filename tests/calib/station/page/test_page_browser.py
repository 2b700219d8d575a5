"""The page in a real browser (Debian's chromium), against a real base-station fed over real Zenoh.

Screenshots are left in out/screenshots, to be looked at.
"""

import re
import secrets
import threading
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from calib.station.page.process import available
from edge.link.link import Link
from edge.link.settings import LinkSettings
from edge.messages import camera_key, camera_of_key
from tests.conftest import Until
from tests.places import ROOT
from tools.doubles.base import NOBODY, Base, scene_config
from tools.doubles.box_messages import SITE, Sent, messages
from tools.doubles.browser import browser
from tools.doubles.feed import feed
from tools.doubles.flight import Spec, make
from tools.doubles.ports import free_endpoint

SCREENSHOTS = ROOT / "out" / "screenshots"
SPEC = Spec(cameras=4, uavs=2, rate_hz=10.0, duration_s=240.0)
TOKEN = secrets.token_hex(16)
STARTED_MS = 60_000  # the page's process imports for seconds where many share two cores
SOON_MS = 20_000
WITHIN_S = 3.0  # a silent camera: two seconds until it counts as gone, and one to say so
STOPPED_S = 5.0  # 3 s are promised; a busy machine takes longer to notice
SLACK_S = 2.0  # a machine that is shared is late by so much

pytestmark = [
    pytest.mark.program("chromium"),
    pytest.mark.skipif(not available(), reason="the extra `page` is not installed"),
]


@dataclass
class Boxes:
    """The cameras' boxes. silent: those that send nothing now."""

    silent: set[str] = field(default_factory=set)
    stop: threading.Event = field(default_factory=threading.Event)

    def sent(self, ready: list[Sent]) -> Iterator[Sent]:
        for message in ready:
            if self.stop.is_set():
                return
            if camera_of_key(message.key) not in self.silent:
                yield message


@dataclass
class Site:
    """A running station."""

    url: str
    folder: Path
    boxes: Boxes


def _station(folder: Path, **status: object) -> Base:
    """A station with a stored calibration."""
    scene = make(SPEC)
    mavlink = {"endpoint": [NOBODY]}
    config = scene_config(scene, free_endpoint(), status={"page": True, **status}, mavlink=mavlink)
    station = Base(folder, config, scene.network)
    station.start()
    return station


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Site]:
    """A station with a stored calibration, and four boxes that send a flight of two objects."""
    boxes, ready = Boxes(), list(messages(make(SPEC)))
    station = _station(tmp_path_factory.mktemp("page"))
    assert ask(station.url + "/status.json")[0] == 200, station.log()
    with Link(LinkSettings(connect=(station.zenoh,)), name="boxes") as link:
        for k in range(SPEC.cameras):
            link.declare_presence(camera_key(SITE, f"cam{k}"))
        thread = threading.Thread(target=feed, args=(link, boxes.sent(ready)))
        thread.start()
        yield Site(station.url, station.folder, boxes)
        boxes.stop.set()
        thread.join()
    assert station.stop(STOPPED_S) == 0, station.log()


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    with browser() as opened:
        yield opened


@dataclass
class Seen:
    """What a browser complained of, and whom it asked."""

    complaints: list[str] = field(default_factory=list)
    asked: set[str] = field(default_factory=set)


@pytest.fixture
def open_page(chromium: Any, site: Site) -> Iterator[Any]:
    """Opens a path at a size; at the end nobody has complained and nobody else was asked."""
    seen, contexts = Seen(), []

    def go(path: str, width: int = 1280, height: int = 900) -> Any:
        context = chromium.new_context(viewport={"width": width, "height": height})
        contexts.append(context)
        page = context.new_page()
        page.on("console", lambda m: seen.complaints.append(m.text) if m.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: seen.complaints.append(str(error)))
        page.on("request", lambda request: seen.asked.add(request.url))
        page.goto(site.url + path, timeout=STARTED_MS)
        page.wait_for_selector(".banner .light", timeout=STARTED_MS)
        return page

    yield go
    for context in contexts:
        context.close()
    assert seen.complaints == []
    own = re.compile(r"^((http|ws)://127\.0\.0\.1:\d+/|data:|blob:)")
    assert [url for url in seen.asked if not own.match(url)] == []


def keep(page: Any, name: str) -> None:
    SCREENSHOTS.mkdir(parents=True, exist_ok=True)
    page.screenshot(path=str(SCREENSHOTS / f"{name}.png"))


def where(page: Any) -> str:
    return str(page.locator("#targets tbody tr").first.inner_text())


def test_a_target_moves_on_the_map(open_page: Any) -> None:
    page = open_page("/")
    page.wait_for_selector("#targets tr[data-target]", timeout=STARTED_MS)
    before, picture = where(page), page.locator("#map").screenshot()
    page.wait_for_function(
        # Between two pictures the table may be empty for a moment.
        "text => { const row = document.querySelector('#targets tbody tr'); return row && row.innerText !== text; }",
        arg=before,
        timeout=SOON_MS,
    )
    page.wait_for_timeout(500)
    assert page.locator("#map").screenshot() != picture
    keep(page, "map")
    page.get_by_role("button", name="3D").click()
    page.get_by_role("button", name="Coverage").click()
    page.wait_for_timeout(300)
    keep(page, "map-3d")


def test_a_silent_camera_turns_red_with_its_reason_and_comes_back(open_page: Any, site: Site) -> None:
    page = open_page("/cameras")
    card = page.locator(".fact[data-camera=cam3]")
    page.wait_for_selector(".fact[data-camera=cam3][data-level=ok]", timeout=SOON_MS)
    keep(page, "cameras")
    site.boxes.silent.add("cam3")
    began = time.monotonic()
    try:
        page.wait_for_selector(".fact[data-camera=cam3][data-level=fail]", timeout=SOON_MS)
        took_s = time.monotonic() - began
        assert "silent" in card.inner_text()
        assert re.search(r"last frame \d+ s ago", card.inner_text()), card.inner_text()
        keep(page, "cameras-one-silent")
    finally:
        site.boxes.silent.clear()
    assert took_s < WITHIN_S + SLACK_S, f"{took_s:.1f} s"
    page.wait_for_selector(".fact[data-camera=cam3][data-level=ok]", timeout=SOON_MS)


def test_a_muted_camera_says_so_in_every_browser_and_moves_no_target(open_page: Any) -> None:
    one, other = open_page("/cameras"), open_page("/")
    one.get_by_role("button", name="Mute cam2", exact=True).click()
    one.wait_for_selector(".fact[data-camera=cam2][data-level=warn]", timeout=SOON_MS)
    other.wait_for_function(
        "() => { const rows = [...document.querySelectorAll('#targets tbody tr')];"
        " return rows.length && rows.every(row => !row.innerText.includes('cam2')); }",
        timeout=SOON_MS,
    )
    one.get_by_role("button", name="Unmute cam2").click()
    one.wait_for_selector(".fact[data-camera=cam2][data-level=ok]", timeout=SOON_MS)


def test_setup_shows_five_steps_the_matrix_and_the_checks(open_page: Any) -> None:
    page = open_page("/setup")
    page.wait_for_selector("li[data-step=calibrate][data-level=ok]", timeout=STARTED_MS)
    names = page.locator("li.step").evaluate_all("found => found.map(e => e.dataset.step)")
    assert names == ["survey", "aim", "check", "calibrate", "go"]
    assert page.locator(".matrix tbody tr").count() == SPEC.cameras
    page.wait_for_function("document.querySelector('.matrix').innerText.includes('mrad')", timeout=SOON_MS)
    assert page.locator(".checks tr").count() >= SPEC.cameras
    keep(page, "setup")


def test_a_reload_keeps_what_was_shown(open_page: Any) -> None:
    page = open_page("/")
    page.wait_for_selector("#targets tr[data-target]", timeout=SOON_MS)
    page.get_by_role("button", name="3D").click()
    page.reload()
    page.wait_for_selector("#targets tr[data-target]", timeout=SOON_MS)
    assert page.get_by_role("button", name="3D").get_attribute("aria-pressed") == "true"
    trails = page.evaluate("() => localStorage.getItem('skyfix-view')")
    assert '"tilt":30' in trails


def test_recording_stops_starts_and_is_scrubbed(open_page: Any, site: Site) -> None:
    live, page = open_page("/"), open_page("/recordings")
    live.wait_for_selector("#targets tr[data-target]", timeout=SOON_MS)
    page.get_by_text("Recording to").wait_for(timeout=SOON_MS)
    page.get_by_role("button", name="Stop recording").click()
    page.get_by_text("Not recording").wait_for(timeout=SOON_MS)
    page.get_by_role("button", name="Start recording").click()
    page.get_by_text("Recording to").wait_for(timeout=SOON_MS)
    oldest = min((site.folder / "recordings").glob("*.mcap"), key=lambda file: file.name)
    page.get_by_role("link", name=oldest.name).click()
    page.wait_for_function("() => Number(document.querySelector('#scrub')?.max) > 0", timeout=SOON_MS)
    page.locator("#scrub").evaluate("e => { e.value = e.max - 0.5; e.dispatchEvent(new Event('input')); }")
    page.wait_for_selector("#targets tr[data-target]", timeout=SOON_MS)
    keep(page, "recording")


def test_the_keyboard_is_enough(open_page: Any) -> None:
    page = open_page("/")
    page.wait_for_selector("#targets tr[data-target]", timeout=SOON_MS)
    for _ in range(40):
        page.keyboard.press("Tab")
        if page.evaluate("document.activeElement.id") == "map":
            break
    assert page.evaluate("document.activeElement.id") == "map"
    before = page.evaluate("localStorage.getItem('skyfix-view')")
    page.keyboard.press("+")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("3")
    after = page.evaluate("localStorage.getItem('skyfix-view')")
    assert before != after
    assert '"tilt":30' in after
    page.keyboard.press("Shift+Tab")
    page.get_by_role("link", name="Setup").focus()
    page.keyboard.press("Enter")
    page.wait_for_url("**/setup")


@pytest.mark.parametrize(("width", "height"), [(320, 640), (3840, 2160)])
@pytest.mark.parametrize("path", ["/", "/setup", "/cameras"])
def test_small_and_large_screens(open_page: Any, path: str, width: int, height: int) -> None:
    page = open_page(path, width, height)
    page.wait_for_timeout(1000)
    keep(page, f"{path.strip('/') or 'map'}-{width}")
    assert page.evaluate("document.documentElement.scrollWidth") <= width


@pytest.fixture
def guarded(tmp_path: Path) -> Iterator[str]:
    """A station whose page wants a token."""
    (tmp_path / "token").write_text(TOKEN)
    (tmp_path / "token").chmod(0o600)
    station = _station(tmp_path, token_file="token")
    yield station.url
    station.stop(STOPPED_S)


def ask(url: str, **headers: str) -> tuple[int, bytes]:
    deadline = time.monotonic() + STARTED_MS / 1000
    while True:
        try:
            with urllib.request.urlopen(urllib.request.Request(url, headers=headers), timeout=30) as answer:
                return answer.status, answer.read()
        except urllib.error.HTTPError as error:
            return error.code, error.read()
        except (urllib.error.URLError, TimeoutError):
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)


def test_a_wrong_token_gets_nothing(guarded: str, chromium: Any, until: Until) -> None:
    for path in ("/", "/setup", "/status.json", "/metrics", "/static/station.js", "/preview/cam0", "/past/x?at_s=0"):
        for url in (guarded + path, f"{guarded}{path}{'&' if '?' in path else '?'}token=wrong"):
            status, body = ask(url)
            assert status in (401, 429), "refused, and after a few wrong ones not even looked at"
            assert SITE.encode() not in body
    assert until(lambda: ask(guarded + "/status.json", Authorization=f"Bearer {TOKEN}")[0] == 200)
    context = chromium.new_context()
    page = context.new_page()
    page.goto(f"{guarded}/setup?token={TOKEN}", timeout=STARTED_MS)
    page.wait_for_selector(".banner .light", timeout=STARTED_MS)
    assert TOKEN not in page.url
    context.close()


def test_the_report_of_an_accepted_calibration_is_served(open_page: Any, site: Site) -> None:
    """The station calibrates by itself as soon as the flight allows; it had only a stored network before."""
    deadline = time.monotonic() + 2 * STARTED_MS / 1000
    while (answer := ask(site.url + "/report"))[0] == 404 and time.monotonic() < deadline:
        time.sleep(1.0)
    assert answer[0] == 200
    assert b"What would improve it most" in answer[1]
    page = open_page("/setup")
    with page.context.expect_page() as opened:
        page.get_by_role("link", name="Report on the last calibration").click()
    opened.value.wait_for_load_state()
    assert "Calibration of" in opened.value.title()
    keep(opened.value, "report-live")


def test_another_name_of_this_machine_gets_nothing(site: Site) -> None:
    """A web site that lets its own name point here (DNS rebinding) sends that name."""
    assert ask(site.url + "/status.json", Host="evil.example")[0] == 401
    assert ask(site.url + "/status.json", Origin="http://evil.example")[0] == 401
