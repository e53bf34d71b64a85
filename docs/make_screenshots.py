"""Screenshots of the reports for these pages: on a desktop's window of 1280 x 800 and on a phone's width.

python docs/make_screenshots.py DEMO.html HEART.html

The first page is the one of `quadriform demo`, the second that of a ventricle; chromium, chromedriver and selenium are
needed.
"""

import io
import shutil
import sys
from pathlib import Path

from PIL import Image
from selenium import webdriver

FIGURES = Path(__file__).parent / "figures"
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


def main() -> None:
    demo, heart = map(Path, sys.argv[1:3])
    driver = browser()
    for name, page, size, scale in (
        ("report_demo", demo, DESKTOP, 0.5),
        ("report_heart", heart, DESKTOP, 0.5),
        ("report_phone", heart, PHONE, 0.6),
    ):
        image = taken(driver, page, size, scale).quantize(COLOURS)
        image.save(FIGURES / f"{name}.png", optimize=True)
    driver.quit()


if __name__ == "__main__":
    main()
