"""Single samples as pictures with what there is to say of them."""

import base64
import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from matplotlib.figure import Figure

from shoot.report.html.markup import Html, element, join, note

_PNG = b"\x89PNG\r\n\x1a\n"
_GROUPS = {"best": "Best", "typical": "Typical", "worst": "Worst"}
# The first of these open the page.
_FIRST = ("best", "worst")


@dataclass(frozen=True)
class SampleCard:
    """One sample, for the page.

    Attributes:
        picture: PNG, as `figure_png` makes it of `render_sample`'s figure.
        token: Of the sample.
        scene: Its scene's name.
        nll: Minus the log-probability of the label, in nats.
        rank: Templates ranked before the label; 0 is best.
        num_templates: How many there are in all.
        description: Its scene in words.

    Raises:
        ValueError: If the picture is no PNG.
    """

    picture: bytes
    token: str
    scene: str
    nll: float
    rank: int
    num_templates: int
    description: str = ""

    def __post_init__(self) -> None:
        if not self.picture.startswith(_PNG):
            raise ValueError(f"The picture of sample '{self.token}' must be a PNG file's bytes.")

    @property
    def probability(self) -> float:
        """Of the label, between 0 and 1."""
        return math.exp(-self.nll)

    @property
    def size_px(self) -> tuple[int, int]:
        """Width and height of the picture."""
        # The first chunk is the header: length and name (8 bytes), then the two sides.
        sides = self.picture[16:20], self.picture[20:24]
        return int.from_bytes(sides[0], "big"), int.from_bytes(sides[1], "big")


def figure_png(figure: Figure, dpi: float = 100.0) -> bytes:
    """A figure as a PNG file's bytes; `render_sample`'s is 1200 pixels wide at 100 dpi."""
    stream = io.BytesIO()
    figure.savefig(stream, format="png", dpi=dpi)
    return stream.getvalue()


def first_cards(cards: Mapping[str, Sequence[SampleCard]]) -> Html:
    """The best and the worst sample side by side; empty if there is neither."""
    figures = [
        _card(cards[group][0], f"{_GROUPS[group]}: ", anchor=group)
        for group in _FIRST
        if cards.get(group)
    ]
    if not figures:
        return Html()
    return join(
        element("div", *figures, class_="pair"),
        note("Blue dashes: driven. Orange: planned. Grey: cost, dark is dear. A click enlarges."),
    )


def other_cards(cards: Mapping[str, Sequence[SampleCard]]) -> dict[str, Sequence[SampleCard]]:
    """The cards that `first_cards` leaves; groups without any are left out."""
    others = {group: of[1:] if group in _FIRST else of for group, of in cards.items()}
    return {group: of for group, of in others.items() if of}


def card_sections(cards: Mapping[str, Sequence[SampleCard]]) -> Html:
    """All cards under the headings of their groups; groups of other names come last."""
    order = [name for name in _GROUPS if name in cards]
    order += [name for name in cards if name not in _GROUPS]
    return join(
        *(
            join(element("h3", _GROUPS.get(name, name)), *(_card(card) for card in cards[name]))
            for name in order
            if cards[name]
        )
    )


def _card(card: SampleCard, word: str = "", anchor: str = "") -> Html:
    """A picture and what there is to say; with an anchor, a link to itself, which enlarges it."""
    percent = 100.0 * card.probability
    shown = f"{percent:.1f} %" if percent >= 0.05 else "below 0.1 %"
    width_px, height_px = card.size_px
    picture = element(
        "img",
        src=f"data:image/png;base64,{base64.b64encode(card.picture).decode()}",
        alt=f"Cameras, cost map and ranked trajectories of sample {card.token}, with the path "
        "that was driven.",
        width=width_px,
        height=height_px,
    )
    caption = element(
        "figcaption",
        element("strong", word, card.scene),
        f": {card.description}" if card.description else "",
        element("br"),
        "Sample ",
        element("code", card.token),
        f". The template nearest to the driven path has rank {card.rank + 1} of "
        f"{card.num_templates}, probability {shown}, NLL {card.nll:.2f} nats.",
    )
    if not anchor:
        return element("figure", picture, caption, class_="card")
    link = element("a", picture, href=f"#{anchor}")
    return element("figure", link, caption, class_="card", id=anchor)
