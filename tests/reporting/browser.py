"""A headless Chromium for the tests of pages; the machine's own, never downloaded."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest


def chromium_path() -> str:
    """Where Chromium is. Skips the test with a reason where there is none, or no driver."""
    pytest.importorskip("playwright.sync_api", reason="playwright is not installed (extra dev)")
    for name in ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable"):
        if path := shutil.which(name):
            return path
    pytest.skip("no Chromium on this machine (Debian: apt-get install chromium)")


@contextmanager
def chromium() -> Iterator["Browser"]:  # noqa: F821
    """A running browser without network."""
    path = chromium_path()
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=path, args=["--no-sandbox"])
        try:
            yield browser
        finally:
            browser.close()


class Watched:
    """A page opened from disk that notes what it complains about and what it asks for."""

    def __init__(self, browser, path: Path, *, dark: bool = False, width: int = 1280) -> None:
        self.complaints: list[str] = []
        self.requests: list[str] = []
        scheme = "dark" if dark else "light"
        self.page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
        self.page.on(
            "console", lambda m: self.complaints.append(m.text) if m.type in ("error", "warning") else None
        )
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", lambda request: self.requests.append(request.url))
        self.page.goto(path.as_uri())

    def close(self) -> None:
        """Close the page and check that it was quiet and kept to itself."""
        address = self.page.url.split("#")[0]
        outside = [url for url in self.requests if url != address and not url.startswith("data:")]
        self.page.close()
        assert self.complaints == []
        assert outside == []
