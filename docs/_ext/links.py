"""After a build: every link inside the pages leads somewhere; links to elsewhere are listed, not followed."""

from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

if TYPE_CHECKING:
    from sphinx.application import Sphinx


class _Page(HTMLParser):
    """Anchors, links, and what a page loads by itself."""

    def __init__(self) -> None:
        super().__init__()
        self.anchors: set[str] = {"", "top"}
        self.links: list[str] = []
        self.loads: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect them."""
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        if "src" in given:
            self.loads.append(given["src"])
        elif tag == "link" and given.get("rel") in ("stylesheet", "icon", "preload", "prefetch"):
            self.loads.append(given.get("href", ""))


def judge(folder: Path) -> tuple[list[str], list[str]]:
    """Complaints about the pages of a folder, and the addresses elsewhere that they name."""
    pages = {path.resolve(): _read(path) for path in sorted(folder.rglob("*.html"))}
    complaints: list[str] = []
    outside: set[str] = set()
    for path, page in pages.items():
        name = path.relative_to(folder.resolve())
        complaints += [f"{name} loads {link}: read offline, it is missing" for link in page.loads if _elsewhere(link)]
        for link in {*page.links, *page.loads}:
            if _elsewhere(link):
                outside.add(link)
            elif why := _broken(link, path, pages):
                complaints.append(f"{name} links to {link}: {why}")
    return sorted(complaints), sorted(outside)


def _read(path: Path) -> _Page:
    page = _Page()
    page.feed(path.read_text("utf-8"))
    return page


def _elsewhere(link: str) -> bool:
    return bool(urlsplit(link).netloc) or urlsplit(link).scheme in ("http", "https", "mailto")


def _broken(link: str, path: Path, pages: dict[Path, _Page]) -> str:
    parts = urlsplit(link)
    if parts.scheme:
        return "" if parts.scheme in ("data", "javascript") else f"what is {parts.scheme}:?"
    target = path if not parts.path else (path.parent / unquote(parts.path)).resolve()
    if not target.is_file():
        return "there is no such file"
    anchor = unquote(parts.fragment)
    if target in pages and anchor not in pages[target].anchors:
        return "there is no such anchor"
    return ""


def _after(app: "Sphinx", error: Exception | None) -> None:
    if error is not None or app.builder.format != "html":
        return
    from sphinx.errors import ExtensionError

    complaints, outside = judge(Path(app.outdir))
    (Path(app.outdir) / "links-elsewhere.txt").write_text("".join(f"{link}\n" for link in outside), encoding="utf-8")
    if complaints:
        raise ExtensionError("links: " + "\n".join(complaints))


def setup(app: "Sphinx") -> dict[str, bool]:
    """Judge the links when a build has ended."""
    app.connect("build-finished", _after)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
