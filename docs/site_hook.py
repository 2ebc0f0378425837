"""What the site takes from outside of ``docs/``: README, two more pages, and every file that a page links.

The pages link as a repository is read, relative to the file. On the site README.md is the first page, and a linked
file (a notebook, the licence) lies under the path that it has in the repository.
"""

from __future__ import annotations

import os
import re
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
PAGES = {"README.md": "index.md", "COLUMNS.md": "columns.md", "CONTRIBUTING.md": "contributing.md"}
LINK = re.compile(r"(?<=\]\()([^)#\s:]+)(?=[)#])")


def outside_of_docs(target: Path) -> bool:
    """Return whether a linked file lies in the repository, but not in ``docs/``."""
    return target.is_file() and target.is_relative_to(ROOT) and not target.is_relative_to(DOCS)


def on_files(files: Any, config: Any) -> Any:
    """Add the pages and the linked files to those of the site."""
    from mkdocs.structure.files import File

    texts = {path: path.read_text(encoding="utf-8") for path in DOCS.rglob("*.md")}
    texts |= {ROOT / name: (ROOT / name).read_text(encoding="utf-8") for name in PAGES}
    for name, page in PAGES.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / name)))
    linked = {(path.parent / link).resolve() for path, text in texts.items() for link in LINK.findall(text)}
    for target in sorted(filter(outside_of_docs, linked)):
        name = str(target.relative_to(ROOT))
        if name not in PAGES:
            files.append(File.generated(config, place_on_site(target), abs_src_path=str(target)))
    return files


def place_on_site(target: Path) -> str:
    """Return where a file of the repository lies on the site, as a path from its root."""
    if target.is_relative_to(DOCS):
        return str(target.relative_to(DOCS))
    name = str(target.relative_to(ROOT))
    # other Markdown files are copied, not rendered
    return PAGES.get(name, name.replace(".md", ".md.txt"))


def on_page_markdown(markdown: str, *, page: Any, config: Any, files: Any) -> str:
    """Return the text of a page with its links as they are on the site."""
    source = Path(page.file.abs_src_path)

    def on_site(link: re.Match[str]) -> str:
        target = (source.parent / link[1]).resolve()
        if not target.is_file():
            return link[1]  # MkDocs names what is not there
        return os.path.relpath(place_on_site(target), Path(page.file.src_uri).parent)

    return LINK.sub(on_site, markdown)
