"""A real browser for the pages; tests that need it are skipped, saying so, where there is none."""

import json
import shutil
from contextlib import contextmanager
from pathlib import Path

import pytest

WITHOUT_3D = """const given = HTMLCanvasElement.prototype.getContext;
HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
    return kind.startsWith("webgl") ? null : given.call(this, kind, ...rest);
};"""


class Browser:
    """Chromium without a window, a network or a GPU; a small window, whose pixels are cheap."""

    def __init__(self):
        webdriver = pytest.importorskip("selenium.webdriver", reason="selenium is not installed: no page was opened")
        program, driver = (shutil.which(name) for name in ("chromium", "chromedriver"))
        if not (program and driver):
            pytest.skip("chromium and chromedriver are not installed: no page was opened")
        options = webdriver.ChromeOptions()
        options.binary_location = program
        for flag in (
            "--headless",
            "--no-sandbox",
            "--disable-gpu",
            "--disable-dev-shm-usage",
            "--window-size=800,1000",
        ):
            options.add_argument(flag)
        options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
        from selenium.common.exceptions import SessionNotCreatedException

        try:
            self.driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(driver))
        except SessionNotCreatedException as error:
            pytest.skip(f"chromium does not start here, no page was opened: {error.msg}")

    def open(self, path):
        """Open a file, wait until its title says ready, and see that nothing went wrong and nothing left the page."""
        self.log("performance")
        self.driver.get(Path(path).resolve().as_uri())
        self.wait_until(lambda: self.driver.title.startswith("ready"))
        self.check()
        return self

    def wait_until(self, is_so):
        """Wait until something is so, however slow the machine is."""
        from selenium.webdriver.support.ui import WebDriverWait

        WebDriverWait(self.driver, 30, 0.05).until(lambda _driver: is_so())

    def check(self):
        """No error on the console, no request but for the page itself."""
        assert [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] == "SEVERE"] == []
        asked = [json.loads(entry["message"])["message"] for entry in self.log("performance")]
        urls = [one["params"]["request"]["url"] for one in asked if one["method"] == "Network.requestWillBeSent"]
        assert [url for url in urls if not url.startswith(("file:", "data:"))] == []
        assert sum(url.startswith("file:") for url in urls) <= 1

    @contextmanager
    def phone(self):
        """The window of a phone, 390 pixels wide."""
        size = {"width": 390, "height": 844, "deviceScaleFactor": 1, "mobile": True}
        self.driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
        yield
        self.driver.execute_cdp_cmd("Emulation.clearDeviceMetricsOverride", {})

    def faults_of_layout(self):
        """What ends beyond the right edge of the window, and text in HTML or drawings smaller than 11.5 pixels."""
        return self.run(
            """const every = [...document.body.querySelectorAll('*')].filter(e => e.checkVisibility());
            const scale = (e, m = e.getScreenCTM?.()) => m ? Math.hypot(m.a, m.b) : 1;
            const cut = e => !e.closest('svg') && e.getBoundingClientRect().right > innerWidth;
            const small = e => e.textContent.trim() && parseFloat(getComputedStyle(e).fontSize) * scale(e) < 11.5;
            return every.filter(e => cut(e) || small(e) && !e.closest('tspan')).map(e => e.outerHTML.slice(0, 80))"""
        )

    def log(self, kind):
        return self.driver.get_log(kind)

    def run(self, script, *arguments):
        """The value of a script in the page."""
        return self.driver.execute_script(script, *arguments)

    def text(self, element):
        return self.run("return document.getElementById(arguments[0]).textContent", element)

    def number(self, element):
        """The number before the unit."""
        return float(self.text(element).split()[0])

    def picture(self):
        """The pixels of the canvas, as one text."""
        return self.run("return document.getElementById('scene').toDataURL()")

    def colours(self):
        """How many different colours a coarse grid of the canvas's pixels has: one is a blank canvas."""
        return self.run(
            """const source = document.getElementById('scene'), copy = document.createElement('canvas');
            copy.width = source.width; copy.height = source.height;
            const context = copy.getContext('2d'); context.drawImage(source, 0, 0);
            const data = context.getImageData(0, 0, copy.width, copy.height).data, found = new Set();
            for (let i = 0; i < data.length; i += 4 * 97) found.add(`${data[i]},${data[i + 1]},${data[i + 2]}`);
            return found.size"""
        )


@pytest.fixture(scope="session")
def browser():
    """With WebGL as the machine has it."""
    one = Browser()
    yield one
    one.driver.quit()


@pytest.fixture
def browser_without_3d(browser):
    """The same, which refuses pages a WebGL context as one without it does: another browser would take seconds."""
    script = {"source": WITHOUT_3D}
    added = browser.driver.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", script)
    yield browser
    assert browser.run("return quadriform.renderer") == "canvas"
    browser.driver.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", added)


@pytest.fixture(params=["browser", "browser_without_3d"], ids=["as it is", "without 3-D"])
def every_browser(request):
    """Both, for what is painted; numbers are the same code in either."""
    return request.getfixturevalue(request.param)
