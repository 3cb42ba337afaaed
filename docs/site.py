"""mkdocs: README.md and CONTRIBUTING.md are pages of the site too, and links mean there what they mean in the source.

A link to a file of the source that the site does not have becomes plain text; one to a file that does not exist stays,
and `mkdocs build --strict` refuses it.
"""

import os
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).resolve().parent.parent
#: File of the source -> its page, or its copy, on the site
OUTSIDE_DOCS = {
    "README.md": "index.md",
    "CONTRIBUTING.md": "contributing.md",
    "hardware/firmware/README.md": "firmware.md",
    "LICENSE": "LICENSE",
    "CITATION.cff": "CITATION.cff",
}
LINK = re.compile(r"\[([^\]]*)\]\(([^):#\s]+)(#[^)\s]*)?\)")


def on_files(files: Files, config: Any) -> Files:
    """Add the files that stand outside docs/."""
    for name, page in OUTSIDE_DOCS.items():
        files.append(File.generated(config, page, content=(ROOT / name).read_text(encoding="utf-8")))
    return files


def on_page_markdown(markdown: str, page: Page, config: Any, files: Files) -> str:
    """Rewrite the links of a page."""
    at = page.file.src_uri
    source = {there: name for name, there in OUTSIDE_DOCS.items()}.get(at, f"docs/{at}")

    def rewritten(link: re.Match[str]) -> str:
        text, target, anchor = link.groups("")
        file = (ROOT / source).parent / target
        if not file.exists():
            return link[0]
        place = os.path.relpath(file, ROOT).replace(os.sep, "/")
        there = OUTSIDE_DOCS.get(place, place.removeprefix("docs/") if place.startswith("docs/") else "")
        if not there or not files.get_file_from_path(there):
            return text
        return f"[{text}]({os.path.relpath(there, Path(at).parent).replace(os.sep, '/')}{anchor})"

    return LINK.sub(rewritten, markdown)
