"""A real browser for the pages."""

from page_browser import browser, browser_without_3d, every_browser

__all__ = ["browser", "browser_without_3d", "every_browser"]
