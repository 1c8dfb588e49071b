"""What mkdocs asks of the project: pages that lie outside docs/, and links out of docs/.

README, changelog and the cards of models become pages of the site. Links to sources lead to the
page of that module; of what is no page (scripts, the licence) the words remain.
"""

import posixpath
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
# Path in the repository -> page of the site.
ELSEWHERE = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "templates/README.md": "models/index.md",
    "templates/synthetic-1000/README.md": "models/synthetic-1000.md",
}
PATH_OF = {page: path for path, page in ELSEWHERE.items()}
LINK = re.compile(r"(!?)\[((?:[^\[\]]|\[[^\]]*\])*)\]\(([^)\s]+)\)")
BLOCK = re.compile(r"(^```.*?^```)", re.MULTILINE | re.DOTALL)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the pages that lie elsewhere."""
    for path, page in ELSEWHERE.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turns links between files of the repository into links between pages."""
    here = page.file.src_uri
    if here.startswith("code/"):
        return markdown
    path = PATH_OF.get(here, f"docs/{here}")

    def turned(found: re.Match[str]) -> str:
        mark, words, target = found.groups()
        if target.startswith(("http://", "https://", "#")):
            return found[0]
        name, _, anchor = target.partition("#")
        to = page_of(posixpath.normpath(posixpath.join(posixpath.dirname(path), name)), files)
        if to is None:
            return str(words)
        to_there = posixpath.relpath(to, posixpath.dirname(here))
        # Lines of a source are no anchors of its page.
        anchored = bool(anchor) and not to.startswith("code/")
        return f"{mark}[{words}]({to_there}{f'#{anchor}' if anchored else ''})"

    parts = BLOCK.split(markdown)
    parts[::2] = [LINK.sub(turned, text) for text in parts[::2]]
    return "".join(parts)


def page_of(path: str, files: Files) -> str | None:
    """The site's file for one of the repository; None if it has none."""
    if path in ELSEWHERE:
        return ELSEWHERE[path]
    if path.endswith(".py"):
        page = f"code/{path.removesuffix('.py')}.md".replace("/__init__.md", "/index.md")
    elif path.startswith("docs/"):
        page = path.removeprefix("docs/")
    else:
        return None
    return page if files.get_file_from_path(page) else None
