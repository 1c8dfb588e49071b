"""The page in a real browser: nothing is fetched, nothing runs, nothing sticks out."""

from pathlib import Path

import pytest
from browser_fixture import visit
from html_fixture import HOSTILE, hostile_page, make_card, make_report
from playwright.sync_api import Browser
from routes_page_case import hostile_routes_page

from shoot.report.html import PageDetails, render_page, write_page
from shoot.report.html.document import POLICY

# Nobody listens there; asking is seen all the same.
ELSEWHERE = "http://127.0.0.1:9/elsewhere.png"
CARDS = {"best": [make_card()]}
DETAILS = PageDetails("small", "synthetic city", "2024-05-06", num_templates=40)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("page") / "report.html"
    write_page(make_report(), CARDS, DETAILS, path)
    return path.as_uri()


@pytest.mark.parametrize("width_px", [1200, 480, 320])
def test_it_asks_for_nothing_complains_of_nothing_and_fits(
    browser: Browser, address: str, width_px: int
) -> None:
    seen = visit(browser, address, width_px)
    assert seen.requests == [address]
    assert seen.complaints == []
    # Tables scroll in their own boxes; the page itself does not scroll sideways.
    assert seen.page.evaluate("document.documentElement.scrollWidth") <= width_px
    assert seen.page.evaluate("[...document.images].every(i => i.naturalWidth > 0)")
    assert seen.page.evaluate("document.images.length") == 1
    assert seen.page.evaluate("document.compatMode") == "CSS1Compat"
    # Plots are drawn: their texts and lines have sizes, and are as large as they say.
    assert seen.page.evaluate(
        "[...document.querySelectorAll('figure svg')].every(s => s.getBBox().width > 100)"
    )


def test_a_click_makes_a_picture_large(browser: Browser, tmp_path: Path) -> None:
    path = tmp_path / "report.html"
    write_page(make_report(), CARDS | {"worst": [make_card(token="other")]}, DETAILS, path)
    page = visit(browser, path.as_uri()).page
    width = "document.querySelector('#worst img').getBoundingClientRect().width"
    small_px = page.evaluate(width)
    page.click("#worst img")
    assert page.evaluate(width) > 2.0 * small_px


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
    seen = visit(browser, path.as_uri())
    assert ELSEWHERE in seen.requests
    assert seen.blocked == ([ELSEWHERE] if has_policy else [])
    assert any("ran" in complaint for complaint in seen.complaints) != has_policy
    assert any("Content Security Policy" in text for text in seen.complaints) == has_policy


@pytest.mark.filterwarnings("ignore:Glyph")
def test_hostile_texts_are_harmless_even_without_the_policy(
    browser: Browser, tmp_path: Path
) -> None:
    path = tmp_path / "hostile.html"
    counts = []
    for word in ("harmless", " ".join(HOSTILE)):
        page = hostile_page(word).replace(POLICY.replace("'", "&#x27;"), "")
        path.write_text(page, encoding="utf-8")
        seen = visit(browser, path.as_uri())
        assert seen.requests == [path.as_uri()]
        assert seen.complaints == []
        counts.append(seen.page.evaluate("document.querySelectorAll('*').length"))
        assert seen.page.evaluate("document.documentElement.scrollWidth") <= 1200
    assert counts[0] == counts[1] > 500


@pytest.mark.parametrize("width_px", [1200, 320])
def test_the_page_of_driven_routes_asks_for_nothing_and_fits(
    browser: Browser, tmp_path: Path, width_px: int
) -> None:
    path = tmp_path / "report.html"
    counts = []
    for word in ("harmless", " ".join(HOSTILE)):
        path.write_text(hostile_routes_page(word), encoding="utf-8")
        seen = visit(browser, path.as_uri(), width_px)
        assert seen.requests == [path.as_uri()]
        assert seen.complaints == []
        assert seen.page.evaluate("document.documentElement.scrollWidth") <= width_px
        assert seen.page.evaluate("[...document.images].every(i => i.naturalWidth > 0)")
        assert seen.page.evaluate("document.images.length") == 1
        counts.append(seen.page.evaluate("document.querySelectorAll('*').length"))
    assert counts[0] == counts[1] > 100
