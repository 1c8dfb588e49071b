"""A real browser for tests of pages: what a page asks for, and what it complains of."""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field

import pytest
from playwright.sync_api import Browser, Dialog, Page, Playwright, Request, sync_playwright

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")


@dataclass
class Visit:
    """What happened while a page was open.

    Attributes:
        page: The tab, for questions to it.
        requests: Addresses asked for, the page's own first; `data:` addresses are not asked for.
        blocked: Those of them that the page's own policy held back.
        complaints: Errors, warnings, dialogues and whatever else is said on the console.
    """

    page: Page
    requests: list[str] = field(default_factory=list)
    blocked: list[str] = field(default_factory=list)
    complaints: list[str] = field(default_factory=list)


def find_program(playwright: Playwright) -> str | None:
    """The system's Chromium or Chrome, else the one that Playwright has fetched."""
    own = playwright.chromium.executable_path
    return next(filter(None, map(shutil.which, (*NAMES, own))), None)


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    with sync_playwright() as playwright:
        program = find_program(playwright)
        if program is None:
            pytest.skip("No Chromium: install the system's, or call `playwright install chromium`.")
        flags = ["--disable-gpu", "--disable-quic", "--disable-sync"]
        with playwright.chromium.launch(executable_path=program, args=flags) as opened:
            yield opened


def visit(browser: Browser, address: str, width_px: int = 1200) -> Visit:
    """Open a page, wait until it and what it asks for is loaded, and a moment more."""
    page = browser.new_page(viewport={"width": width_px, "height": 900})
    seen = Visit(page)

    def answer(dialog: Dialog) -> None:
        seen.complaints.append(f"dialogue: {dialog.message}")
        dialog.accept()

    def fail(request: Request) -> None:
        if request.failure == "csp":
            seen.blocked.append(request.url)

    page.on("request", lambda request: seen.requests.append(request.url))
    page.on("requestfailed", fail)
    page.on("console", lambda message: seen.complaints.append(message.text))
    page.on("pageerror", lambda error: seen.complaints.append(str(error)))
    page.on("dialog", answer)
    page.goto(address)
    page.wait_for_timeout(100.0)
    return seen
