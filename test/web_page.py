"""The page in headless Chromium, handled as a person does."""

import math
import os
import shutil
import tempfile

from ros_testing import wait_until


def missing():
    """Return why there is no browser to test with, empty where there is one."""
    try:
        import selenium  # noqa: F401
    except ImportError:
        return "python3-selenium is not installed"
    for program in ("chromium", "chromedriver"):
        if shutil.which(program) is None:
            return f"{program} is not installed"
    return ""


class WebPage:
    """One tab; `close` ends the browser and leaves nothing behind."""

    def __init__(self, width=1280, height=760, phone=False, dark=False):
        from selenium import webdriver
        from selenium.webdriver.chrome.options import Options
        from selenium.webdriver.chrome.service import Service

        self._home = tempfile.mkdtemp(prefix="web page ")
        options = Options()
        options.binary_location = shutil.which("chromium")
        for argument in (
            "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--hide-scrollbars",
            f"--window-size={width},{height}", f"--user-data-dir={self._home}",
        ):
            options.add_argument(argument)
        if phone:
            metrics = {"width": width, "height": height, "pixelRatio": 2.0}
            options.add_experimental_option("mobileEmulation", {"deviceMetrics": metrics})
        options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
        self.driver = webdriver.Chrome(
            service=Service(shutil.which("chromedriver"), log_path=os.devnull), options=options
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.driver.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": [scheme]})

    def open(self, url):
        """Go to an address."""
        self.driver.get("about:blank")  # else one that differs in its token alone would not be loaded anew
        self.driver.get(url)

    def js(self, expression):
        """Return the value of an expression."""
        return self.driver.execute_script(f"return ({expression});")

    def wait(self, expression, what, timeout=60.0):
        """Return the first value of an expression that is true."""
        return wait_until(lambda: self.js(expression), f"{what} in the page", timeout, 0.1)

    def text(self, identifier):
        """Return what an element says."""
        return self.js(f"document.getElementById('{identifier}').textContent.trim()")

    def click(self, identifier):
        """Click an element."""
        self.driver.find_element("id", identifier).click()

    def click_hidden(self, identifier):
        """Click an element wherever it is, scrolled out of sight or not."""
        self.driver.execute_script(f"document.getElementById('{identifier}').click()")

    def pixel(self, x, y):
        """Return where a place in the map (m) lies in the window."""
        return self.js(
            "(() => { const box = document.getElementById('canvas').getBoundingClientRect();"
            f"const [c, r] = page.camera.toScreen({x}, {y}); return [c + box.left, r + box.top]; }})()")

    def drag(self, tool, x, y, heading):
        """Take a tool, press at a place in the map (m), drag towards a heading (rad), and let go."""
        self.driver.find_element("css selector", f"[data-tool={tool}]").click()
        column, row = self.pixel(x, y)
        self._mouse("mousePressed", column, row)
        for reach in (15, 30, 45):
            self._mouse("mouseMoved", column + reach * math.cos(heading), row - reach * math.sin(heading))
        self._mouse("mouseReleased", column + 45 * math.cos(heading), row - 45 * math.sin(heading))

    def _mouse(self, kind, x, y):
        self.driver.execute_cdp_cmd("Input.dispatchMouseEvent", dict(
            type=kind, x=x, y=y, button="left", buttons=0 if kind == "mouseReleased" else 1, clickCount=1))

    def touch(self, kind, fingers):
        """Send a touch event of one kind, with the places (pixels) of all fingers that touch."""
        points = [{"x": x, "y": y, "id": number} for number, (x, y) in enumerate(fingers)]
        self.driver.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    def colours(self):
        """Return how many colours the drawn map has, of every hundredth pixel."""
        return self.js(
            "(() => { const c = document.getElementById('canvas'); page.redraw();"
            "const d = c.getContext('2d').getImageData(0, 0, c.width, c.height).data, s = new Set();"
            "for (let i = 0; i < d.length; i += 400) s.add(d[i] << 16 | d[i + 1] << 8 | d[i + 2]); return s.size; })()")

    def complaints(self):
        """Return the errors of the page's console, those of a connection that was lost aside."""
        return [
            entry["message"]
            for entry in self.driver.get_log("browser")
            if entry["level"] == "SEVERE"
            and "WebSocket" not in entry["message"]
            and "ERR_CONNECTION" not in entry["message"]
        ]

    def close(self):
        """End the browser."""
        self.driver.quit()
        shutil.rmtree(self._home, ignore_errors=True)
