"""A real browser for the pages."""

from page_browser import browser

__all__ = ["browser"]
