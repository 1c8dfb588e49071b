"""The page in a real browser: nothing is fetched, nothing runs, nothing sticks out."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from browser import Browser, find_browser
from html_fixture import HOSTILE, hostile_page, make_card, make_report

from shoot.html_report import PageDetails, render_page, write_page
from shoot.html_report.page import POLICY

PROGRAM = find_browser()
pytestmark = pytest.mark.skipif(PROGRAM is None, reason="no Chromium or Chrome to be found")

# Nobody listens there; asking is seen all the same.
ELSEWHERE = "http://127.0.0.1:9/elsewhere.png"
CARDS = {"best": [make_card()]}
DETAILS = PageDetails("small", "synthetic city", "2024-05-06", num_templates=40)


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    assert PROGRAM is not None
    with Browser(PROGRAM, tmp_path_factory.mktemp("profile")) as opened:
        yield opened


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_page(make_report(), CARDS, DETAILS, path)
    return path.as_uri()


@pytest.mark.parametrize("width_px", [1200, 480, 320])
def test_it_asks_for_nothing_complains_of_nothing_and_fits(
    browser: Browser, address: str, width_px: int
) -> None:
    visit = browser.visit(address, width_px)
    assert visit.requests[0] == address
    assert set(visit.requests[1:]) <= {"data:"}
    assert visit.complaints == []
    # Tables scroll in their own boxes; the page itself does not scroll sideways.
    assert browser.evaluate("document.documentElement.scrollWidth") <= width_px
    assert browser.evaluate("[...document.images].every(i => i.naturalWidth > 0)")
    assert browser.evaluate("document.images.length") == 1
    assert browser.evaluate("document.compatMode") == "CSS1Compat"
    # Plots are drawn: their texts and lines have sizes, and are as large as they say.
    assert browser.evaluate(
        "[...document.querySelectorAll('figure svg')].every(s => s.getBBox().width > 100)"
    )


@pytest.mark.parametrize("has_policy", [True, False])
def test_the_policy_is_what_forbids_and_the_watch_sees_it(
    browser: Browser, tmp_path: Path, has_policy: bool
) -> None:
    page = render_page(make_report(), {}, DETAILS)
    smuggled = f"<script>console.log('ran')</script><img src='{ELSEWHERE}'></body>"
    page = page.replace("</body>", smuggled)
    if not has_policy:
        assert POLICY.replace("'", "&#x27;") in page
        page = page.replace(POLICY.replace("'", "&#x27;"), "")
    path = tmp_path / "smuggled.html"
    path.write_text(page, encoding="utf-8")
    visit = browser.visit(path.as_uri())
    assert ELSEWHERE in visit.requests
    assert visit.blocked == ([ELSEWHERE] if has_policy else [])
    assert any("ran" in complaint for complaint in visit.complaints) != has_policy
    assert any("Content Security Policy" in text for text in visit.complaints) == has_policy


@pytest.mark.filterwarnings("ignore:Glyph")
def test_hostile_texts_are_harmless_even_without_the_policy(
    browser: Browser, tmp_path: Path
) -> None:
    path = tmp_path / "hostile.html"
    counts = []
    for word in ("harmless", " ".join(HOSTILE)):
        page = hostile_page(word).replace(POLICY.replace("'", "&#x27;"), "")
        path.write_text(page, encoding="utf-8")
        visit = browser.visit(path.as_uri())
        assert visit.requests[0] == path.as_uri()
        assert set(visit.requests[1:]) <= {"data:"}
        assert visit.complaints == []
        counts.append(browser.evaluate("document.querySelectorAll('*').length"))
        assert browser.evaluate("document.documentElement.scrollWidth") <= 1200
    assert counts[0] == counts[1] > 500
