"""A hook of the documentation site: files that a page links become files of the site, and pages have their titles."""

import posixpath
import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File, Files

LINK = re.compile(r"\]\(((?:\.\./)+)((?:examples|ros2|scenarios)/[^)#]+)\)")
"""A link that leads out of the folder of the documents."""
NAMED_BY_FILE = re.compile(r"\[\w+\.md\](?=\(([\w./]+\.md)[#)])")
"""The text of a link to a page that is named by its file, as on GitHub."""


def on_files(files: Files, config: Any) -> Files:
    """Add every linked file to the site, below `files/`."""
    root, docs = Path(config.config_file_path).parent, Path(config.docs_dir)
    files.remove(files.src_uris["links_to_files.py"])
    linked = {path for page in docs.rglob("*.md") for _, path in LINK.findall(page.read_text(encoding="utf-8"))}
    for path in sorted(linked):
        files.append(File.generated(config, f"files/{path}", content=(root / path).read_bytes()))
    return files


def on_page_markdown(markdown: str, page: Any, files: Files, **_: Any) -> str:
    """Let links lead to these files, and name pages as the menu does."""

    def title(match: re.Match[str]) -> str:
        uri = posixpath.normpath(posixpath.join(posixpath.dirname(page.file.src_uri), match[1]))
        return f"[{files.src_uris[uri].content_string.splitlines()[0].removeprefix('# ')}]"

    markdown = NAMED_BY_FILE.sub(title, markdown)
    return LINK.sub(lambda match: f"]({match[1][3:]}files/{match[2]})", markdown)
