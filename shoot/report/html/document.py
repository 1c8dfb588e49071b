"""A page as a file of its own: nothing fetched, no script but a known one, one look."""

from typing import Final

from shoot.report.html.markup import Html, element, join
from shoot.report.html.style import STYLE

# The browser may fetch nothing, run nothing and send nothing, whatever stands in the page.
POLICY: Final = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"


def document(title: str, body: Html, style: str = STYLE, policy: str = POLICY) -> str:
    """The whole page as text.

    Args:
        title: Shown by the browser.
        body: All that is seen.
        style: Of the page, CSS.
        policy: What the browser may do, as a content security policy.
    """
    head = join(
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=policy),
        element("meta", name="viewport", content="width=device-width, initial-scale=1"),
        element("title", title),
        element("style", Html(style)),
    )
    page = element("html", element("head", head), element("body", body), lang="en")
    return f"<!DOCTYPE html>\n{page}\n"
