"""Pages of which a command makes some parts: each stands between two markers."""

from collections.abc import Mapping
from pathlib import Path

from lss_core.errors import DataError
from lss_core.files import write_atomically


def fill_page(page: Path, name: str, text: str) -> None:
    """Put text between a page's markers `<!-- name -->` and `<!-- /name -->`.

    Raises:
        DataError: If the page has not each of them once.
    """
    begin, end = f"<!-- {name} -->", f"<!-- /{name} -->"
    whole = page.read_text(encoding="utf-8")
    if not whole.count(begin) == whole.count(end) == 1:
        raise DataError(f"'{page}' must hold {begin} and {end} once each; {name} goes between.")
    head, rest = whole.split(begin)
    tail = rest.split(end)[1]
    with write_atomically(page) as stream:
        stream.write(f"{head}{begin}\n\n{text}\n\n{end}{tail}".encode())


def fill_pages(root: Path, parts: Mapping[str, str]) -> None:
    """Put each part wherever the pages of a repository have markers for it.

    Args:
        root: Folder of README.md and docs/.
        parts: Name to text. A part may stand on several pages, as a short one and a full one.

    Raises:
        DataError: If a part stands on no page; none is changed then.
    """
    pages = sorted([*root.glob("*.md"), *root.glob("docs/**/*.md")])
    texts = {page: page.read_text(encoding="utf-8") for page in pages}
    places = {name: [p for p in pages if f"<!-- {name} -->" in texts[p]] for name in parts}
    for name, found in places.items():
        if not found:
            raise DataError(f"No page of '{root}' holds <!-- {name} --> and <!-- /{name} -->.")
    for name, found in places.items():
        for page in found:
            fill_page(page, name, parts[name])
