"""Check of the links after a build: targets inside the pages exist; external links are listed, not followed."""

from html.parser import HTMLParser
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import unquote, urlsplit

if TYPE_CHECKING:
    from sphinx.application import Sphinx


class _Page(HTMLParser):
    """Anchors and links of a page, and the resources that it loads."""

    def __init__(self) -> None:
        super().__init__()
        self.anchors: set[str] = {"", "top"}
        self.links: list[str] = []
        self.loads: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect anchors, links and resources of a tag."""
        given = {name: value or "" for name, value in attrs}
        self.anchors |= {given[name] for name in ("id", "name") if name in given}
        if tag == "a" and "href" in given:
            self.links.append(given["href"])
        if "src" in given:
            self.loads.append(given["src"])
        elif tag == "link" and given.get("rel") in ("stylesheet", "icon", "preload", "prefetch"):
            self.loads.append(given.get("href", ""))


def check_links(folder: Path) -> tuple[list[str], list[str]]:
    """Broken links in the pages of a folder, and the external addresses that they name."""
    pages = {path.resolve(): _read(path) for path in sorted(folder.rglob("*.html"))}
    problems: list[str] = []
    external: set[str] = set()
    for path, page in pages.items():
        name = path.relative_to(folder.resolve())
        problems += [
            f"{name} loads {link}: an external resource is missing when read offline"
            for link in page.loads
            if _is_external(link)
        ]
        for link in {*page.links, *page.loads}:
            if _is_external(link):
                external.add(link)
            elif why := _broken(link, path, pages):
                problems.append(f"{name} links to {link}: {why}")
    return sorted(problems), sorted(external)


def _read(path: Path) -> _Page:
    page = _Page()
    page.feed(path.read_text("utf-8"))
    return page


def _is_external(link: str) -> bool:
    return bool(urlsplit(link).netloc) or urlsplit(link).scheme in ("http", "https", "mailto")


def _broken(link: str, path: Path, pages: dict[Path, _Page]) -> str:
    parts = urlsplit(link)
    if parts.scheme:
        return "" if parts.scheme in ("data", "javascript") else f"unknown scheme {parts.scheme}:"
    target = path if not parts.path else (path.parent / unquote(parts.path)).resolve()
    if not target.is_file():
        return "the file does not exist"
    anchor = unquote(parts.fragment)
    if target in pages and anchor not in pages[target].anchors:
        return "the anchor does not exist"
    return ""


def _after(app: "Sphinx", error: Exception | None) -> None:
    if error is not None or app.builder.format != "html":
        return
    from sphinx.errors import ExtensionError

    problems, external = check_links(Path(app.outdir))
    (Path(app.outdir) / "external-links.txt").write_text("".join(f"{link}\n" for link in external), encoding="utf-8")
    if problems:
        raise ExtensionError("links: " + "\n".join(problems))


def setup(app: "Sphinx") -> dict[str, bool]:
    """Check the links at the end of a build."""
    app.connect("build-finished", _after)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
