"""The page alone, without a robot: what is in reach on any screen, what is told twice, where a map is shown."""

import functools
import http.server
import json
import math
import os
import threading

import pytest
from web_page import WebPage, missing

import mbf_relay.ros.web

pytestmark = pytest.mark.skipif(bool(missing()), reason=missing())

SCREENS = [  # of phones, upright and on their side, of tablets and of laptops
    (320, 568), (360, 640), (390, 844), (640, 360), (667, 375), (844, 390), (932, 430), (768, 1024), (1024, 768),
    (1280, 760),
]
STATE = {
    "layer": "state", "fit": None, "error": None, "has_map": True, "move_base": True, "robots": ["/"], "browsers": 1,
    "master": True, "simulator": True, "driver": None, "tour": None, "recording": False,
    "goal": {
        "state": "idle", "outcome": "", "goal": None, "planning": False, "driving": False, "recovering": "",
        "left": None, "time_left": None,
    },
}
COVERED = """(() => { const covered = [];
  for (const control of document.querySelectorAll(".map button, #stick, #cancel, #handle")) {
    const box = control.getBoundingClientRect();
    if (!box.width) continue;
    for (const [x, y] of [[0.5, 0.5], [0.1, 0.5], [0.9, 0.5], [0.5, 0.1], [0.5, 0.9]]) {
      const found = document.elementFromPoint(box.left + box.width * x, box.top + box.height * y);
      if (!found || !control.contains(found)) {
        covered.push(`${control.id || control.dataset.tool} is under ${found && (found.id || found.tagName)}`);
      }
    }
  } return covered; })()"""


class Quiet(http.server.SimpleHTTPRequestHandler):
    """Serves files without a word."""

    def log_message(self, *_):
        """Say nothing."""


@pytest.fixture(scope="module")
def browser():
    """A browser with the page's address; nothing answers its WebSocket."""
    folder = os.path.join(os.path.dirname(os.path.abspath(mbf_relay.ros.web.__file__)), "page")
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=folder))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    page = WebPage()
    page.url = f"http://127.0.0.1:{server.server_port}/"
    yield page
    page.close()
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.fixture
def page(browser):
    """The page as it is with a robot, of which these tests tell it themselves."""
    browser.open(browser.url)
    browser.wait("window.page && true", "the page")
    browser.driver.execute_script("page.connection.open = () => {}; clearTimeout(page.connection.retry);")
    welcome(browser)
    show(browser, STATE)
    return browser


def welcome(page, robot="/"):
    """Tell the page that it is connected, and may drive."""
    page.driver.execute_script(
        f"page.connection.on.say({{say: 'welcome', number: 1, drive: true, robot: '{robot}', guess: false}});"
        "page.connection.on.state('good', 'live');")


def show(page, *headers):
    """Have parts without a payload come to the page."""
    parts = json.dumps([{"header": header} for header in headers])
    page.driver.execute_async_script(f"page.connection.on.batch({parts}).then(arguments[0]);")


def resize(page, width, height):
    """Give the page another screen."""
    page.driver.execute_cdp_cmd(
        "Emulation.setDeviceMetricsOverride", dict(width=width, height=height, deviceScaleFactor=1, mobile=False))
    page.wait(f"innerWidth === {width} && innerHeight === {height}", "the size of the screen")


def show_map(page, **header):
    """Have a map of free cells come to the page, or some of its tiles."""
    cells = f"new Blob([new Uint8Array({header['tile'] ** 2 * len(header['tiles'])})]).stream()"
    page.driver.execute_async_script(
        f"const done = arguments[0], packed = {cells}.pipeThrough(new CompressionStream('deflate'));"
        "new Response(packed).arrayBuffer().then((payload) =>"
        f"page.connection.on.batch([{{header: {json.dumps(header)}, payload}}]).then(done));")


def waypoints(page):
    """Return what the list of waypoints says."""
    return page.js("[...document.querySelectorAll('#waypoints span')].map((item) => item.textContent)")


@pytest.mark.parametrize("width, height", SCREENS)
def test_no_control_lies_under_another_so_that_who_zooms_does_not_drive(page, width, height):
    resize(page, width, height)
    for tool in ("look", "waypoint", "pose"):
        page.driver.execute_script(f"document.querySelector('button[data-tool={tool}]').click()")
        assert page.js(COVERED) == [], tool
    if page.js("document.getElementById('handle').getBoundingClientRect().width > 0"):
        page.click("handle")
        assert page.js(COVERED) == [], "with all controls shown"


def test_a_waypoint_s_button_can_be_pressed_and_tabbed_to_while_the_robot_tells_how_it_is(page):
    resize(page, 1280, 760)
    page.driver.execute_script("document.querySelector('button[data-tool=waypoint]').click()")
    for column in (200, 300):
        page._mouse("mousePressed", column, 300)
        page._mouse("mouseReleased", column, 300)
    first, second = waypoints(page)
    page.driver.execute_script("document.querySelector('#waypoints button').focus()")
    show(page, STATE)
    assert page.js("document.activeElement.getAttribute('aria-label')") == "Remove waypoint 1"
    page.driver.execute_script("document.activeElement.click()")
    assert waypoints(page) == [second] != [first]


def test_a_waypoint_that_is_not_taken_is_told_of(page):
    """The 51st place of a round was pressed like all others, and the robot left it out without a word."""
    resize(page, 1280, 760)
    page.driver.execute_script("document.querySelector('button[data-tool=waypoint]').click()")
    for number in range(51):
        assert page.js("document.querySelectorAll('#toasts > *').length") == 0, f"at number {number + 1}"
        page._mouse("mousePressed", 200 + 8 * number, 300)
        page._mouse("mouseReleased", 200 + 8 * number, 300)
    assert len(waypoints(page)) == 50
    assert "50 waypoints at most" in page.js("document.getElementById('toasts').textContent")
    show(page, {**STATE, "tour": {"waypoints": [[0.0, 0.0, 0.0]], "index": 0, "loop": False}})
    page._mouse("mousePressed", 300, 300)
    page._mouse("mouseReleased", 300, 300)
    assert "a list is being driven" in page.js("document.getElementById('toasts').textContent")


def test_text_of_the_diagnostics_can_be_selected_while_others_change(page):
    entries = [{"level": 2, "name": "amcl", "text": "no scan"}, {"level": 0, "name": "server", "text": "0.1 s"}]
    show(page, {"layer": "diagnostics", "entries": entries})
    page.driver.execute_script("getSelection().selectAllChildren(document.querySelector('#diagnostics small'))")
    entries[1]["text"] = "0.2 s"
    show(page, {"layer": "diagnostics", "entries": entries})
    assert page.js("getSelection().toString()") == "no scan"
    assert "0.2 s" in page.text("diagnostics")


def test_a_warning_is_told_once_though_the_connection_was_lost_meanwhile(page):
    told = [{"time": f"10:00:0{second}", "node": "/amcl", "level": "warn", "text": "late"} for second in range(3)]
    show(page, {"layer": "log", "entries": told[:2]})
    welcome(page)
    show(page, {"layer": "log", "entries": told})
    assert page.js("[...document.querySelectorAll('#log b')].map((item) => item.textContent)") == [
        "10:00:02 /amcl", "10:00:01 /amcl", "10:00:00 /amcl"]


def test_who_closes_the_question_for_a_token_is_asked_again_and_not_left_with_a_dead_page(page):
    page.driver.execute_script(
        "page.connection.on.state('bad', 'no access');"
        "page.connection.on.say({say: 'goodbye', why: 'the token is wrong or missing'});")
    for _ in range(3):
        page.wait("document.getElementById('token-dialog').open", "the question for a token")
        page.driver.execute_script("document.getElementById('token-dialog').close()")
    page.wait("document.getElementById('token-dialog').open", "the question for a token")
    page.driver.execute_script("page.connection.on.state('good', 'live')")
    welcome(page)
    assert not page.js("document.getElementById('token-dialog').open")


def test_a_browser_that_keeps_nothing_for_pages_shows_the_robot_all_the_same(browser):
    forbid = "".join(
        f"Object.defineProperty(window, '{area}', {{get() {{ throw new DOMException('denied', 'SecurityError'); }}}});"
        for area in ("localStorage", "sessionStorage"))
    script = browser.driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": forbid})
    try:
        browser.open(browser.url)
        browser.wait("window.page && true", "the page", 20.0)
        welcome(browser)
        browser.click("theme")
        show(browser, STATE)
        assert browser.text("outcome") == "No goal"
    finally:
        browser.driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)


@pytest.mark.parametrize("has_map, told", [(False, "there is no map"), (True, "where the robot is on")])
def test_who_waits_for_a_robot_that_is_not_there_is_told_so(page, has_map, told):
    show(page, {**STATE, "has_map": has_map})
    page.wait("!document.getElementById('banner').hidden", "a word about it", 30.0)
    assert told in page.text("banner")
    show(page, {"layer": "robot", "pose": [0.0, 0.0, 0.0], "speed": [0.0, 0.0], "frames": {}})
    page.wait("document.getElementById('banner').hidden", "nothing more to say", 30.0)


def test_who_holds_a_stick_that_is_refused_is_told_so_once(page):
    """Twelve times a second came "another browser is driving", to those who hear the page, too, and no other word."""
    for _ in range(5):
        for why in ("another browser is driving", "nobody listens to /cmd_vel"):
            page.driver.execute_script(f"page.connection.on.say({{say: 'refused', wish: 'stick', why: '{why}'}})")
    assert page.js("[...document.getElementById('toasts').children].map((note) => note.textContent)") == [
        "another browser is driving", "nobody listens to /cmd_vel"]


def test_a_page_that_is_loaded_anew_asks_for_the_robot_it_showed(page):
    welcome(page, "/burger2/")
    page.driver.refresh()
    page.wait("window.page && true", "the page")
    assert page.js("page.connection.robot") == "/burger2/"


def test_who_was_shown_a_robot_that_is_away_can_choose_another(page):
    welcome(page, "/burger2/")
    show(page, {**STATE, "robots": ["/burger1/"]})
    assert page.js("[...document.getElementById('robot').options].map((option) => option.value)") == [
        "/burger2/", "/burger1/"]
    assert page.js("document.getElementById('robot').value") == "/burger2/"
    assert page.js("document.getElementById('robot-field').hidden") is False


def test_the_error_of_a_robot_that_stands_is_the_newest(page):
    show(page, {"layer": "robot", "pose": [0.0, 0.0, 0.0], "speed": [0.0, 0.0], "frames": {}}, {**STATE, "error": 2.5})
    show(page, {**STATE, "error": 0.01})
    assert page.text("chart-error") == "1.0 cm"


def test_a_pose_estimate_draws_no_path_through_walls(page):
    for x in (0.0, 0.1, 0.2, 3.2, 3.3):
        show(page, {"layer": "robot", "pose": [x, 0.0, 0.0], "speed": [0.2, 0.0], "frames": {}})
    assert page.js("page.scene.trail.map(([x, , jumped]) => [x, Boolean(jumped)])") == [
        [0, False], [0.1, False], [0.2, False], [3.2, True], [3.3, False]]


def test_another_map_comes_into_sight_and_one_that_grows_leaves_the_view_alone(page):
    shape = {"layer": "map", "width": 64, "height": 64, "tile": 64, "frame": "map", "resolution": 0.05}
    place = "(() => { const { x, y, scale } = page.camera; return [x, y, scale]; })()"

    def come(**more):
        show_map(page, **shape, **more)
        return page.js(place)

    first = come(tiles=[0], origin=[0.0, 0.0, 0.0])
    assert come(tiles=[0], origin=[-1.0, -1.0, 0.0]) == first
    page.driver.execute_script("page.camera.pan(5000, 0)")
    away = page.js(place)
    assert come(tiles=[0], origin=[-1.0, -1.0, 0.0]) == away, "who looks elsewhere is left there"
    assert come(tiles=[0], origin=[100.0, 50.0, 0.0])[:2] == [101.6, 51.6]


def test_a_large_map_that_comes_in_portions_is_shown_whole(page):
    shape = {"layer": "map", "width": 64, "height": 640, "tile": 64, "frame": "map", "resolution": 0.05}
    for tiles in ([0, 1], [2, 3, 4, 5], [6, 7, 8, 9]):
        show_map(page, **shape, origin=[0.0, 0.0, 0.0], tiles=tiles)
    assert page.js("[page.camera.x, page.camera.y]") == [1.6, 16.0]


def test_a_costmap_whose_frame_is_nowhere_is_not_shown_at_the_map_s_origin(page):
    """Before localization has begun walls round the robot were drawn somewhere else on the map."""
    shape = {"width": 64, "height": 64, "tile": 64, "tiles": [0], "frame": "odom", "resolution": 0.05}
    header = json.dumps({**shape, "origin": [-1.6, -1.6, 0.0]})
    page.driver.execute_script(f"page.scene.grids.local_costmap.take({header}, new Uint8Array(4096).fill(100))")
    seen = []
    for place in ([0.0, 0.0, 0.0], None):
        show(page, {"layer": "robot", "pose": None, "speed": [0.0, 0.0], "frames": {"odom": place}})
        page.driver.execute_async_script(
            "page.redraw(); requestAnimationFrame(() => requestAnimationFrame(arguments[0]))")
        seen.append(page.js("(() => { const c = document.getElementById('canvas'), d = c.getContext('2d').getImageData("
                            "c.width / 2, c.height / 2, 1, 1).data; return d[0] - d[1]; })()"))
    assert seen[0] > 100 > seen[1]


def test_another_tool_in_the_middle_of_a_drag_calls_it_off(page):
    """A goal that was being dragged when p was pressed told the robot that it is there."""
    resize(page, 1280, 760)
    page.driver.execute_script("page.connection.send = (wish) => (window.sent = wish, true);")
    page.driver.execute_script("document.querySelector('button[data-tool=goal]').click()")
    page._mouse("mousePressed", 200, 300)
    page.driver.execute_script("document.body.dispatchEvent(new KeyboardEvent('keydown', {key: 'p', bubbles: true}))")
    page._mouse("mouseMoved", 260, 300)
    page._mouse("mouseReleased", 260, 300)
    assert page.js("window.sent && window.sent.do") is None


@pytest.mark.parametrize("degrees, meant", [(90, 90), (-400, -40), (400, 40)])
def test_a_position_may_be_typed_with_any_heading(page, degrees, meant):
    """-400 degrees were sent as they are, and refused."""
    page.driver.execute_script("page.connection.send = (wish) => (window.sent = wish, true);")
    page.driver.execute_script(
        f"const form = document.getElementById('goto'); form.heading.value = '{degrees}'; form.requestSubmit()")
    assert page.js("window.sent.theta") == pytest.approx(math.radians(meant))


@pytest.mark.parametrize(
    "origin, resolution", [([-5.0, 3.0, 0.0], 0.05), ([2.0, -7.0, 2.0], 0.05), ([0.0, 0.0, -0.7], 50.0)])
def test_the_whole_map_is_shown_however_it_is_turned_and_as_large_as_it_is(page, origin, resolution):
    resize(page, 390, 844)
    header = {
        "width": 64, "height": 32, "tile": 64, "tiles": [0], "frame": "map", "resolution": resolution, "origin": origin,
    }
    page.driver.execute_script(f"page.scene.grids.map.take({json.dumps(header)}, new Uint8Array(64 * 32))")
    page.click("fit")
    outside = page.js(
        "(() => { const { origin: [x, y, turn], width, height, resolution } = page.scene.grids.map.shape;"
        "return [[0, 0], [width, 0], [width, height], [0, height]].map(([c, r]) => page.camera.toScreen("
        "x + resolution * (c * Math.cos(turn) - r * Math.sin(turn)),"
        "y + resolution * (c * Math.sin(turn) + r * Math.cos(turn))))"
        ".filter(([c, r]) => c < 0 || r < 0 || c > page.camera.width || r > page.camera.height); })()")
    assert outside == []


def test_a_page_keeps_its_connection_while_its_tab_is_hidden_and_when_it_is_shown_again(page):
    """With timers once a minute it pinged as seldom, took the silence between for a lost connection, and began anew."""
    kept = page.driver.execute_script("""
        const connection = page.connection, kept = [];
        const now = performance.now.bind(performance);
        let later = 0;
        performance.now = () => now() + later;
        clearTimeout(connection.retry);
        const socket = { readyState: WebSocket.OPEN, send: (wish) => socket.sent = JSON.parse(wish).do, close() {} };
        connection.socket = socket;
        connection.take(socket, '{"say": "pong"}');
        for (const [wait, answered] of [[60000, true], [60000, false], [2000, false], [6000, false]]) {
          later += wait;
          socket.sent = "";
          document.dispatchEvent(new Event("visibilitychange"));
          kept.push(connection.socket === socket && socket.sent === "ping");
          if (answered) connection.take(socket, '{"say": "pong"}');
        }
        delete performance.now;
        return kept;""")
    assert kept == [True, True, True, False]
