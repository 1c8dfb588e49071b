"""A report made by hand, with every number different, and a reader of the page made of it."""

import io
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from html.parser import HTMLParser
from typing import Any

import numpy as np
from PIL import Image

from shoot.evaluation.results import Report, Results
from shoot.metrics.bootstrap import Interval
from shoot.metrics.calibration import Reliability
from shoot.report.html import PageDetails, SampleCard, render_page
from shoot.report.html.columns import GROUPS, MAIN

KEYS = tuple(column.key for columns in (MAIN, *(g.columns for g in GROUPS)) for column in columns)
METHODS = ("model", "prior", "constant_velocity")
VOID = {"meta", "br", "img"}

HOSTILE = (
    "<script>alert(1)</script>",
    "</title></style><img src=x onerror=alert(1)>",
    '" onload="alert(1)" x=\'',
    "a & b &amp; &lt;c&gt;",
    "$\\frac{1}{$ $x$ \\$",
    "]]><!-- </svg>",
    "nul\x00bell\x07 half\udc80 wide語",
)


class Numbers:
    """Intervals whose values all differ by 1 or more, so that each is found on the page."""

    def __init__(self, has_bounds: bool = True) -> None:
        self.last = 10.0
        self.has_bounds = has_bounds

    def interval(self) -> Interval:
        self.last += 1.125
        reach = 0.25 if self.has_bounds else float("nan")
        return Interval(self.last, self.last - reach, self.last + reach)

    def metrics(self, keys: tuple[str, ...] = KEYS) -> dict[str, Interval]:
        return {key: self.interval() for key in keys}


def make_results(
    numbers: Numbers, methods: tuple[str, ...] = METHODS, keys: tuple[str, ...] = KEYS
) -> Results:
    checks = tuple(key for key in keys if key.startswith(("collision", "off_road", "comfort")))
    spread = np.array([0.1, 0.2, 0.4])
    bins = Reliability(spread, spread[::-1].copy(), np.array([4, 4, 4]))
    return Results(
        num_samples=12,
        num_scenes=3 if numbers.has_bounds else 1,
        num_groups=3 if numbers.has_bounds else 1,
        methods={name: numbers.metrics(keys) for name in methods},
        differences={
            name: numbers.metrics(keys)
            for name in methods
            if "model" in methods and name != "model"
        },
        oracle={key: numbers.interval() for key in ("ade", "fde", "miss_rate")},
        driver=numbers.metrics(checks),
        reliability=dict.fromkeys(methods, bins),
    )


def make_report(
    has_bounds: bool = True,
    methods: tuple[str, ...] = METHODS,
    keys: tuple[str, ...] = KEYS,
    split: str = "val",
    conditions: tuple[str, ...] = ("day", "night rain"),
) -> Report:
    numbers = Numbers(has_bounds)

    def parts(names: tuple[str, ...]) -> dict[str, Results]:
        return {name: make_results(numbers, methods, keys) for name in names}

    return Report(
        split=split,
        overall=make_results(numbers, methods, keys),
        by_manoeuvre=parts(("standing", "straight")),
        by_condition=parts(conditions),
        by_speed=parts(("0-1 m/s", "over 10 m/s")),
        num_boxes_left_out=7,
        num_samples_with_boxes_left_out=5,
    )


def make_card(**changed: Any) -> SampleCard:
    stream = io.BytesIO()
    Image.new("RGB", (60, 40), "gray").save(stream, "PNG")
    values: dict[str, Any] = {
        "picture": stream.getvalue(),
        "token": "3f2a-token",
        "scene": "scene-0103",
        "nll": 1.25,
        "rank": 3,
        "num_templates": 40,
        "description": "Night, big street",
    }
    return SampleCard(**values | changed)


CARDS = {"best": [make_card()], "worst": [make_card(token="0b-other", nll=9.0, rank=39)]}
DETAILS = PageDetails("runs/small", "synthetic city", "2024-05-06 07:08", "best", 40)


def page_of(report: Report, **changed: Any) -> "Node":
    """The page of a report with a best and a worst sample."""
    return read_page(render_page(report, CARDS, replace(DETAILS, **changed)))


def section_of(page: "Node", anchor: str) -> "Node":
    """The section that the contents lead to by this name."""
    (section,) = (node for node in page.all("section") if node.attributes.get("id") == anchor)
    return section


def rows_of(page: "Node", name: str, corner: str | None = None) -> list["Node"]:
    """Rows whose first cell says this, in tables whose corner says that, if it matters."""
    return [
        row
        for table in page.all("table")
        if corner in (None, table.all("th")[0].text)
        for row in table.all("tr")
        if row.all("th") and row.all("th")[0].text == name
    ]


def hostile_page(word: str) -> str:
    """A page with the same text in every place that text can come from."""
    report = make_report(
        methods=("model", word),
        keys=(*KEYS, f"key {word}"),
        split=word,
        conditions=(word, "day"),
    )
    cards = {
        word: [make_card(token=word, scene=word, description=word)],
        "best": [make_card(token=f"best {word}")],
    }
    return render_page(report, cards, PageDetails(word, word, word, word, 40))


@dataclass
class Node:
    tag: str
    attributes: dict[str, str | None]
    children: list["Node | str"] = field(default_factory=list)

    def __iter__(self) -> Iterator["Node"]:
        """Itself and all nodes below, in order."""
        yield self
        for child in self.children:
            if isinstance(child, Node):
                yield from child

    def all(self, *tags: str) -> list["Node"]:
        return [node for node in self if node.tag in tags]

    @property
    def text(self) -> str:
        return "".join(c if isinstance(c, str) else c.text for c in self.children)

    @property
    def lines(self) -> list[str]:
        """The texts inside, each by itself."""
        found: list[str] = []
        for child in self.children:
            found += [child] if isinstance(child, str) else child.lines
        return found


class PageReader(HTMLParser):
    """A strict reader: every element is closed in turn, none is closed twice."""

    def __init__(self) -> None:
        super().__init__()
        self.root = Node("", {})
        self.open = [self.root]
        self.doctype = ""

    def handle_decl(self, decl: str) -> None:
        self.doctype = decl

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert len(dict(attrs)) == len(attrs), f"<{tag}> has an attribute twice"
        node = Node(tag, dict(attrs))
        self.open[-1].children.append(node)
        if tag not in VOID:
            self.open.append(node)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        in_svg = any(node.tag == "svg" for node in self.open)
        assert in_svg, f"<{tag}/> closes itself, which HTML does not know"
        self.open[-1].children.append(Node(tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        assert self.open[-1].tag == tag, f"</{tag}> where <{self.open[-1].tag}> is open"
        self.open.pop()

    def handle_data(self, data: str) -> None:
        self.open[-1].children.append(data)


def read_page(page: str) -> Node:
    reader = PageReader()
    reader.feed(page)
    reader.close()
    assert reader.doctype.lower() == "doctype html"
    assert reader.open == [reader.root], f"<{reader.open[-1].tag}> is never closed"
    return reader.root
