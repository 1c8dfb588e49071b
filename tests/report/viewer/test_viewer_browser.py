"""The page of a scene in a real browser, by keyboard and by mouse: it shows what it is told to."""

import re
from pathlib import Path

import pytest
from browser_fixture import Visit, visit
from html_fixture import HOSTILE
from playwright.sync_api import Browser, Page, expect
from viewer_case import NUM_SAMPLES, hostile_page, make_scene

from shoot.report.html.document import POLICY
from shoot.report.viewer.page import render_viewer, write_viewer

PLANNED = "#ground .planned-path"


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("page") / "scene.html"
    write_viewer(make_scene(), path)
    return path.as_uri()


@pytest.fixture
def opened(browser: Browser, address: str) -> Visit:
    return visit(browser, address)


def shown(page: Page) -> int:
    """Number of the sample, from 1; all parts of the page agree on it."""
    (number,) = re.findall(r"^Sample (\d+) of 8, ", page.inner_text("#status"))
    assert page.input_value("#slider") == str(int(number) - 1)
    assert page.inner_text("#token") == f"token-{int(number) - 1}"
    samples = make_scene().samples
    assert page.get_attribute("#cameras img", "src") == samples[int(number) - 1].images[0].picture
    assert page.get_attribute("#cost", "src") == samples[int(number) - 1].cost
    return int(number)


def test_keys_choose_the_sample(opened: Visit) -> None:
    page = opened.page
    assert shown(page) == 1
    for key, number in [
        ("ArrowLeft", 1), ("ArrowRight", 2), ("ArrowRight", 3), ("ArrowLeft", 2),
        ("End", NUM_SAMPLES), ("ArrowRight", NUM_SAMPLES), ("Home", 1),
    ]:  # fmt: skip
        page.keyboard.press(key)
        assert shown(page) == number
    # What belongs to the browser stays with it.
    page.keyboard.press("Control+End")
    assert shown(page) == 1
    # The slider's own keys do not make two steps of one.
    page.focus("#slider")
    page.keyboard.press("ArrowRight")
    assert shown(page) == 2
    assert opened.complaints == []


def test_the_mouse_chooses_the_sample(opened: Visit) -> None:
    page = opened.page
    page.click("#next")
    assert shown(page) == 2
    page.click("#previous")
    assert shown(page) == 1
    box = page.locator("#slider").bounding_box()
    assert box is not None
    page.mouse.click(box["x"] + box["width"] - 3, box["y"] + 0.5 * box["height"])
    assert shown(page) == NUM_SAMPLES
    box = page.locator("#chart").bounding_box()
    assert box is not None
    for number in (3, 6, 1):
        page.mouse.click(
            box["x"] + (number - 0.5) / NUM_SAMPLES * box["width"], box["y"] + 0.3 * box["height"]
        )
        assert shown(page) == number
    page.mouse.down()
    page.mouse.move(box["x"] + 4.5 / NUM_SAMPLES * box["width"], box["y"] + 5.0)
    page.mouse.up()
    assert shown(page) == 5
    assert opened.complaints == []


def test_space_plays_and_stops_at_the_end(opened: Visit) -> None:
    page = opened.page
    page.keyboard.press("Space")
    assert page.inner_text("#play") == "Pause"
    expect(page.locator("#play")).to_have_text("Play")
    assert shown(page) == NUM_SAMPLES
    # From the end it begins again; a button in focus is pressed once, not twice.
    page.focus("#play")
    page.keyboard.press("Space")
    assert page.inner_text("#play") == "Pause"
    page.keyboard.press("Space")
    assert page.inner_text("#play") == "Play"
    assert shown(page) < NUM_SAMPLES


def test_keys_and_buttons_choose_how_many_templates(opened: Visit) -> None:
    page = opened.page

    def counts() -> set[int]:
        ends = page.locator("#cameras .planned-end").count()
        rows = page.locator("#rows tr").count()
        assert ends <= rows  # one that ends at the car's own place is not seen
        return {page.locator(PLANNED).count(), rows, int(page.inner_text("#count"))}

    assert counts() == {10}
    for key, count in [("3", 3), ("-", 2), ("+", 3), ("1", 1), ("-", 1), ("0", 10), ("+", 10)]:
        page.keyboard.press(key)
        assert counts() == {count}
    page.click("#fewer")
    assert counts() == {9}
    page.click("#more")
    assert counts() == {10}
    assert page.is_disabled("#more")


def test_it_says_what_the_data_say(opened: Visit) -> None:
    page = opened.page
    assert page.inner_text("h1") == "scene-0003"
    status = page.inner_text("#status").replace("\xa0", " ")
    assert status == (
        "Sample 1 of 8, 0.0 s. Top-10 hit: what was driven ranks 1 of 24, probability 20.0 %."
    )
    rows = [
        row.replace("\xa0", " ").split("\t") for row in page.locator("#rows tr").all_inner_texts()
    ]
    assert rows[0] == ["1", "20.0 % as driven", "0.0 m", ""]
    assert rows[3] == ["4", "5.0 %", "6.0 m", "1.5 m left"]
    page.keyboard.press("End")
    status = page.inner_text("#status").replace("\xa0", " ")
    assert status == (
        "Sample 8 of 8, 0.7 s. Top-10 missed: what was driven ranks 15 of 24, probability 1.3 %."
    )
    assert page.get_attribute("#slider", "aria-valuetext").replace("\xa0", " ") == status
    # Ranks 1, 3, 5, 7, 9 are among ten; 11, 13, 15 are not.
    assert page.locator("#chart .sample").count() == NUM_SAMPLES
    assert page.locator("#chart .missed").count() == 3


def points_of(path: str) -> list[list[float]]:
    """Of a path's `d`."""
    return [[float(number) for number in pair.split()] for pair in path.strip("Mz").split("L")]


def test_what_is_ahead_is_up_and_what_is_left_is_left(opened: Visit) -> None:
    page = opened.page
    page.keyboard.press("ArrowRight")
    # The last is the best, template 0; before it template 1, which ends 2 m ahead, 0.5 m left.
    second = points_of(page.locator(PLANNED).nth(8).get_attribute("d"))
    assert second[0] == [0.0, 0.0]
    assert second[-1] == pytest.approx([-0.5, -2.0])
    box = points_of(page.get_attribute("#ground .box", "d"))
    assert box[0] == [-4.0, -10.0]
    # The road stays where it is while the car drives 1 m.
    road = points_of(page.get_attribute("#ground .road", "d"))
    assert road == [[-4.0, 21.0], [-4.0, -59.0]]
    # By hand: 10 m ahead, 0.1 m left is seen at u = 0.5 - 0.01, v = 0.5 + 0.15.
    driven = points_of(page.get_attribute("#cameras .driven-path", "d"))
    assert driven[-1] == pytest.approx([0.49, 0.65])
    # A close-up shows less ground; picture and paths grow together.
    wide = page.locator("#cost").bounding_box()
    page.keyboard.press("c")
    close = page.locator("#cost").bounding_box()
    assert wide is not None
    assert close is not None
    _, top_m, _, height_m = map(float, page.get_attribute("#ground", "viewBox").split())
    assert (top_m, height_m) == (-32.0, 40.0)
    assert close["height"] == pytest.approx(wide["height"] * 70.0 / height_m, rel=0.01)
    # The picture's upper edge is 60 m ahead, 28 m above what is shown.
    assert close["y"] == pytest.approx(wide["y"] - 28.0 / 70.0 * close["height"], abs=1.0)
    assert page.get_attribute("#close-up", "aria-pressed") == "true"


@pytest.mark.parametrize(
    ("width_px", "has_images"), [(1200, True), (320, True), (1200, False), (390, False)]
)
def test_it_asks_for_nothing_complains_of_nothing_and_fits(
    browser: Browser, tmp_path: Path, width_px: int, has_images: bool
) -> None:
    path = tmp_path / "scene.html"
    write_viewer(make_scene(has_images), path)
    seen = visit(browser, path.as_uri(), width_px)
    page = seen.page
    for key in ("ArrowRight", "c", "5", "End", "Space"):
        page.keyboard.press(key)
    assert seen.requests == [path.as_uri()]
    assert seen.complaints == []
    assert page.evaluate("document.documentElement.scrollWidth") <= width_px
    # All pictures there are can be read: of a lidar planner the map and the scan.
    wanted = ["#cost", "#cameras figure:not(.none) img"] if has_images else ["#cost", "#points"]
    for name in wanted:
        assert page.evaluate(f"document.querySelector('{name}').naturalWidth") > 0
    assert page.locator("#cameras").is_visible() == has_images
    # What can be used has a name, and can be seen to be in focus.
    for name in ("previous", "play", "next", "slider", "fewer", "more", "close-up"):
        page.focus(f"#{name}:not(:disabled)")
        page.keyboard.press("Shift")
        outline = f"getComputedStyle(document.getElementById('{name}')).outlineStyle"
        assert page.evaluate(outline) == "solid"
        label = page.get_attribute(f"#{name}", "aria-label") or page.inner_text(f"#{name}")
        assert len(label) > 3


def test_hostile_texts_are_harmless_even_without_the_policy(
    browser: Browser, tmp_path: Path
) -> None:
    path = tmp_path / "hostile.html"
    counts = []
    for word in ("harmless", " ".join(HOSTILE)):
        page = hostile_page(word)
        policy = re.findall(r'<meta http-equiv="[^"]*" content="[^"]*">', page)
        assert len(policy) == 1
        path.write_text(page.replace(policy[0], ""), encoding="utf-8")
        seen = visit(browser, path.as_uri())
        assert seen.requests == [path.as_uri()]
        assert seen.complaints == []
        counts.append(seen.page.evaluate("document.querySelectorAll('*').length"))
        assert "harmless" in seen.page.inner_text("h1") or "</title>" in seen.page.inner_text("h1")
    assert counts[0] == counts[1] > 100


def test_no_other_script_runs(browser: Browser, tmp_path: Path) -> None:
    page = render_viewer(make_scene())
    assert POLICY.replace("'", "&#x27;") in page
    path = tmp_path / "smuggled.html"
    path.write_text(page.replace("</body>", "<script>document.title = 'ran'</script></body>"))
    seen = visit(browser, path.as_uri())
    assert seen.page.title() == "scene-0003"
    assert any("Content Security Policy" in text for text in seen.complaints)
    assert shown(seen.page) == 1
