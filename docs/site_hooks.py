# Copyright 2026 Seed 64efc911 maintainers
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""What MkDocs does with the pages of docs/ so that they read well in the repository and on the site.

* ``<!-- include: FILE -->`` or ``<!-- include: FILE#Heading -->`` becomes the text of a file of the
  repository, or of one section of it, so that no table stands in two places.
* A link to a file of the repository outside docs/ leads to a copy of it on the site.
* Cells of tables get the heading of their column, which stands before them on a phone (site.css).
* The word after the language of a code block (``test``, ``ros``), which tells test/test_docs.py what to do
  with it, is taken off.
"""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent.parent
DOCS = "docs"

INCLUDE = re.compile(r"^<!-- include: ([^#\s]+)(?:#(.+?))? -->$", re.MULTILINE)
HEADING = re.compile(r"^(#+) (.+)$", re.MULTILINE)
FENCE = re.compile(r"^```(\w+) \w+$", re.MULTILINE)
CODE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)
TABLE = re.compile(r"<table>.*?</table>", re.DOTALL)
_HEAD_CELL = re.compile(r"<th\b[^>]*>(.*?)</th>", re.DOTALL)
_ROW = re.compile(r"<tr>.*?</tr>", re.DOTALL)
_TAG = re.compile(r"<[^>]+>")
# [text](target), ![text](target); not where it has spaces, so no title.
LINK = re.compile(r"(\]\()([^)\s]+)(\))")
_EXTERNAL = re.compile(r"[a-z]+:")
# The page that stands for the README on the site, unless it has the section that is linked.
_HOME = "index.md"


def on_config(config: Any) -> Any:
    """Put pages that the navigation does not list under "Reference"."""
    config.nav = with_all_pages(config.nav)
    return config


def with_all_pages(nav: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the navigation with every page of docs/ in it."""
    missing = [page.name for page in pages() if f"'{page.name}'" not in repr(nav)]
    return [
        {title: [*part, *missing] if title == "Reference" else part}
        for entry in nav
        for title, part in entry.items()
    ]


def on_files(files: Any, config: Any) -> Any:
    """Add what the pages link to outside docs/, and what that links to."""
    from mkdocs.structure.files import File  # noqa: PLC0415  (test/test_docs.py runs without MkDocs)

    for path in sorted(linked_outside()):
        if path != "README.md":
            files.append(File.generated(config, path, abs_src_path=str(ROOT / path)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Return the text of a page as MkDocs shall see it."""
    uri = page.file.src_uri
    own = ROOT / DOCS / uri
    return page_text(markdown, f"{DOCS}/{uri}" if own.is_file() else uri)


def on_page_content(html: str, **_: Any) -> str:
    """Return the content of a page as the site shows it."""
    return TABLE.sub(lambda match: labelled(match[0]), html)


def labelled(table: str) -> str:
    """Return a table whose cells name their columns.

    Args:
        table: The table as HTML, as Python-Markdown makes it.
    """
    heads = [_TAG.sub("", head).replace('"', "&quot;") for head in _HEAD_CELL.findall(table)]

    def row(match: re.Match[str]) -> str:
        first, *cells = match[0].split("<td")
        named = zip(heads, cells, strict=False)
        return first + "".join(f'<td data-label="{head}"{cell}' for head, cell in named)

    return _ROW.sub(row, table)


def page_text(markdown: str, path: str) -> str:
    """Resolve includes, links and the marks of code blocks of one page.

    Args:
        markdown: Text of the page.
        path: Its place in the repository.
    """
    text = INCLUDE.sub(lambda match: relinked(section(*match.groups()), match[1], path), _off(markdown, path))
    if not HEADING.match(text.lstrip()):  # a table of the benchmark
        text = f"# {Path(path).stem.replace('_', ' ').capitalize()}\n\n{text}"
    return FENCE.sub(r"```\1", text)


def section(file: str, heading: str | None) -> str:
    """Return a file of the repository, or what stands under one of its headings up to the next like it.

    Raises:
        ValueError: The file has no such heading.
    """
    text = (ROOT / file).read_text(encoding="utf-8")
    if heading is None:
        return text
    code = [match.span() for match in CODE.finditer(text)]
    found = [match for match in HEADING.finditer(text) if not any(a <= match.start() < b for a, b in code)]
    for index, match in enumerate(found):
        if match[2] == heading:
            later = [other for other in found[index + 1 :] if len(other[1]) <= len(match[1])]
            return text[match.end() : later[0].start() if later else len(text)].strip() + "\n"
    raise ValueError(f"{file} has no heading {heading!r}")


def relinked(text: str, source: str, page: str) -> str:
    """Return text whose links are relative to the page it stands on.

    Args:
        text: Markdown of the file ``source``.
        source: Where it was written, in the repository.
        page: Where it is shown, in the repository.
    """

    def target(match: re.Match[str]) -> str:
        link = match[2]
        if _EXTERNAL.match(link):
            return match[0]
        path, mark, anchor = link.partition("#")
        place = posixpath.normpath(posixpath.join(posixpath.dirname(source), path)) if path else source
        if place == "README.md":
            place = f"{DOCS}/{_readme_anchors().get(anchor, _HOME)}"
        if place == page and anchor:
            return f"{match[1]}#{anchor}{match[3]}"
        start = posixpath.dirname(_on_site(page)) or "."
        return f"{match[1]}{posixpath.relpath(_on_site(place), start)}{mark}{anchor}{match[3]}"

    parts = re.split(f"({CODE.pattern}|`[^`\n]+`)", text, flags=CODE.flags)
    return "".join(part if part.startswith("`") else LINK.sub(target, part) for part in parts)


def slug(heading: str) -> str:
    """Return the anchor of a heading, as GitHub and MkDocs make it."""
    return re.sub(r"[\s]+", "-", re.sub(r"[^\w\s-]", "", heading).strip().lower())


def pages() -> Iterator[Path]:
    """Yield the pages of docs/."""
    yield from sorted((ROOT / DOCS).glob("*.md"))


def links_of(text: str) -> list[str]:
    """Return the links of a text, code left out."""
    return [match[2] for match in LINK.finditer(CODE.sub("", text)) if not _EXTERNAL.match(match[2])]


def linked_outside() -> set[str]:
    """Return the files of the repository outside docs/ that the site needs, by what links to them."""
    needed: set[str] = set()
    waiting = [page.relative_to(ROOT).as_posix() for page in pages()]
    while waiting:
        file = waiting.pop()
        text = (ROOT / file).read_text(encoding="utf-8")
        sources = [(file, text), *((m[1], section(*m.groups())) for m in INCLUDE.finditer(text))]
        for source, part in sources:
            for link in links_of(part):
                path = link.partition("#")[0]
                place = posixpath.normpath(posixpath.join(posixpath.dirname(source), path))
                outside = path and not place.startswith((f"{DOCS}/", ".."))
                if outside and place not in needed and (ROOT / place).is_file():
                    needed.add(place)
                    if place.endswith(".md") and place != "README.md":
                        waiting.append(place)
    return needed


def _off(markdown: str, path: str) -> str:
    """Return a page with its own links resolved; those of what it includes are resolved apart."""
    return relinked(markdown, path, path)


def _on_site(path: str) -> str:
    return path.removeprefix(f"{DOCS}/")


def _readme_anchors() -> dict[str, str]:
    """Return which page has which section of the README."""
    anchors = {}
    for page in pages():
        for match in INCLUDE.finditer(page.read_text(encoding="utf-8")):
            if match[1] == "README.md" and match[2]:
                anchors[slug(match[2])] = page.name
                for _, heading in HEADING.findall(section(*match.groups())):
                    anchors[slug(heading)] = page.name
    return anchors
