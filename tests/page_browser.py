"""A real browser for the pages; tests that need it are skipped, saying so, where there is none."""

import json
import shutil
from pathlib import Path

import pytest


class Browser:
    """Chromium without a window, a network or a GPU."""

    def __init__(self, *flags):
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
            "--window-size=1200,1600",
            *flags,
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
        from selenium.webdriver.support.ui import WebDriverWait

        self.log("performance")
        self.driver.get(Path(path).resolve().as_uri())
        WebDriverWait(self.driver, 30, 0.05).until(lambda driver: driver.title.startswith("ready"))
        self.check()
        return self

    def check(self):
        """No error on the console, no request but for the page itself."""
        assert [entry["message"] for entry in self.driver.get_log("browser") if entry["level"] == "SEVERE"] == []
        asked = [json.loads(entry["message"])["message"] for entry in self.log("performance")]
        urls = [one["params"]["request"]["url"] for one in asked if one["method"] == "Network.requestWillBeSent"]
        assert [url for url in urls if not url.startswith(("file:", "data:"))] == []
        assert sum(url.startswith("file:") for url in urls) <= 1

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


def _opened(*flags):
    one = Browser(*flags)
    yield one
    one.driver.quit()


@pytest.fixture(scope="session")
def browser():
    """With WebGL as the machine has it."""
    yield from _opened()


@pytest.fixture(scope="session")
def browser_without_3d():
    yield from _opened("--disable-3d-apis")


@pytest.fixture(params=["browser", "browser_without_3d"], ids=["as it is", "without 3-D"])
def every_browser(request):
    """Both, for what is painted; numbers are the same code in either."""
    return request.getfixturevalue(request.param)
