"""HTML in which text from outside cannot become markup."""

import html

from lss_core.legible import legible

_VOID = frozenset({"br", "col", "img", "meta"})


class Html(str):
    """Text that is markup already. Any other `str` is escaped where it enters a page.

    Adding two of them gives a plain `str`, which would be escaped; use `join`.
    """

    __slots__ = ()


def element(tag: str, *children: str, **attributes: str | int) -> Html:
    """One element; children that are not `Html`, and all attribute values, are escaped.

    Args:
        tag: Name, as in `td`.
        children: Inside of the element, in order.
        attributes: `class_` gives class, `aria_label` gives aria-label.
    """
    written = "".join(
        f' {name.rstrip("_").replace("_", "-")}="{html.escape(legible(str(value)))}"'
        for name, value in attributes.items()
    )
    if tag in _VOID:
        return Html(f"<{tag}{written}>")
    return Html(f"<{tag}{written}>{join(*children)}</{tag}>")


def join(*children: str, between: str = "") -> Html:
    """Children one after the other, those that are not `Html` escaped."""
    return Html(between.join(_escaped(child) for child in children))


def note(text: str) -> Html:
    """A paragraph beside the matter: what a heading, a table or a plot is about."""
    return element("p", text, class_="note")


def folded(title: str, *children: str) -> Html:
    """What is read only by those who open it."""
    return element("details", element("summary", title), *children)


def _escaped(child: str) -> str:
    return child if isinstance(child, Html) else html.escape(legible(child))
