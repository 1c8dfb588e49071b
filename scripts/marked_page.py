"""Pages whose middle part a command makes: it stands between two markers."""

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
