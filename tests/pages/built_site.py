"""Judges a built site: every link in it leads to a file and an anchor there, and nothing is loaded from a network."""

from __future__ import annotations

import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import NamedTuple
from urllib.parse import unquote, urlsplit

# What a browser loads without a click: tag → the attribute that names it.
LOADED = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src"}


class Page(NamedTuple):
    links: list[str]
    loaded: list[str]
    anchors: set[str]


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.page = Page([], [], set())

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        named = {key: value for key, value in attributes if value is not None}
        self.page.anchors.update(named[key] for key in ("id", "name") if key in named)
        if tag == "a" and "href" in named:
            self.page.links.append(named["href"])
        elif LOADED.get(tag) in named and named.get("rel") != "canonical":
            self.page.loaded.append(named[LOADED[tag]])


def read(text: str) -> Page:
    reader = _Reader()
    reader.feed(text)
    return reader.page


def faults(site: Path) -> tuple[list[str], int]:
    """The faults, and how many links and loaded files were checked."""
    pages = {path.resolve(): read(path.read_text()) for path in site.rglob("*.html")}
    found, count = [], 0
    for path, page in pages.items():
        where = path.relative_to(site.resolve())
        for target in [*page.links, *page.loaded]:
            count += 1
            address = urlsplit(target)
            if address.scheme or address.netloc:
                if target in page.loaded and address.scheme != "data":
                    found.append(f"{where}: loads {target} from a network")
                continue
            leads_to = (path.parent / unquote(address.path)).resolve() if address.path else path
            if not leads_to.exists():
                found.append(f"{where}: {target}: no such file")
            elif address.fragment and leads_to in pages and unquote(address.fragment) not in pages[leads_to].anchors:
                found.append(f"{where}: {target}: no such heading")
    return found, count


def main(site: Path) -> int:
    found, count = faults(site)
    for fault in found:
        print(fault, file=sys.stderr)
    size = sum(path.stat().st_size for path in site.rglob("*") if path.is_file())
    pages = sum(1 for _ in site.rglob("*.html"))
    print(f"{site}: {pages} pages, {count} links, {len(found)} broken, {size / 1e6:.0f} MB; begin with index.html")
    return 1 if found or not pages else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
