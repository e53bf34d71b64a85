"""The reports in these pages, on a desktop's window of 1280 x 800 and on a phone's width; the slices of the demo.

python docs/make_screenshots.py

The pages are made first: that of `quadriform demo`, and that of the ventricle of the tutorial on a beating heart.
Chromium, chromedriver and selenium are needed.
"""

import io
import shutil
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from make_figures import DOCS, run
from PIL import Image
from selenium import webdriver

from quadriform.cli.demo import demo
from quadriform.cli.reporting import track_options
from quadriform.report.reports import track_report

FIGURES = DOCS / "figures"
PHONE, DESKTOP = (390, 844), (1280, 800)
COLOURS = 64
"""Of the palette that keeps a picture small."""


def browser() -> webdriver.Chrome:
    options = webdriver.ChromeOptions()
    options.binary_location = str(shutil.which("chromium"))
    for flag in ("--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars"):
        options.add_argument(flag)
    return webdriver.Chrome(options=options, service=webdriver.ChromeService(shutil.which("chromedriver")))


def taken(driver: webdriver.Chrome, page: Path, size: tuple[int, int], scale: float) -> Image.Image:
    """The whole page at this width, as the window's height is made its own; smaller by `scale`."""
    metrics = {"width": size[0], "height": size[1], "deviceScaleFactor": 1, "mobile": size[0] < 600}
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
    driver.get(page.resolve().as_uri())
    wide = driver.execute_script("return document.documentElement.scrollWidth")
    if wide > size[0]:
        raise SystemExit(f"{page.name}: {wide} pixels wide in a window of {size[0]}")
    tall = driver.execute_script("return document.documentElement.scrollHeight")
    driver.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics | {"height": tall})
    image = Image.open(io.BytesIO(driver.get_screenshot_as_png())).convert("RGB")
    return image.resize((round(image.width * scale), round(image.height * scale)), Image.Resampling.LANCZOS)


def heart_page() -> bytes:
    """The report of the tutorial's ventricle, with its measures below the base."""
    names = run(DOCS / "tutorials" / "beating_heart.md")
    found, models = names["found"], tuple(names["models"])
    found = replace(found, models=models, moving=replace(found.moving, space="LPS", unit="mm"))
    record = {"strategy": found.strategy} | track_options({"period": 1.0})
    return track_report(found, names["frames"], title="synthetic ventricle", record=record, measures=names["table"])


def main() -> None:
    with TemporaryDirectory() as folder:
        demo(output=Path(folder) / "demo", force=False)
        slices = Image.open(Path(folder) / "demo" / "slices.png").convert("RGB")
        slices.quantize(COLOURS).save(FIGURES / "demo.png", optimize=True)
        heart = Path(folder) / "heart.html"
        heart.write_bytes(heart_page())
        driver = browser()
        for name, page, size, scale in (
            ("report_demo", Path(folder) / "demo" / "report.html", DESKTOP, 0.5),
            ("report_heart", heart, DESKTOP, 0.5),
            ("report_phone", heart, PHONE, 0.6),
        ):
            image = taken(driver, page, size, scale).quantize(COLOURS)
            image.save(FIGURES / f"{name}.png", optimize=True)
        driver.quit()


if __name__ == "__main__":
    main()
