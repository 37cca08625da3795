"""The notebooks of ``notebooks/`` as pages: copied into the sources before a build, with a page that lists them."""

import shutil
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sphinx.application import Sphinx

NONE = "This checkout contains no notebooks.\n"


def gather(source: Path, target: Path) -> None:
    """Copy changed notebooks, remove deleted ones, and write the page that lists them."""
    target.mkdir(exist_ok=True)
    found = sorted(source.glob("*.ipynb"))
    for old in target.glob("*.ipynb"):
        if old.name not in {path.name for path in found}:
            old.unlink()
    for path in found:
        if not (copy := target / path.name).is_file() or copy.read_bytes() != path.read_bytes():
            shutil.copyfile(path, copy)
    listed = "\n".join(["```{toctree}", ":maxdepth: 1", "", *(path.stem for path in found), "```"]) if found else NONE
    intro = "Each notebook was executed when these pages were built; the checkout contains no outputs.\n"
    page = f"# Notebooks\n\n{intro}\n{listed}\n"
    if not (index := target / "index.md").is_file() or index.read_text("utf-8") != page:
        index.write_text(page, encoding="utf-8")


def setup(app: "Sphinx") -> dict[str, bool]:
    """Copy the notebooks before the sources are read."""
    here = Path(app.srcdir)
    app.connect("builder-inited", lambda _: gather(here.parent / "notebooks", here / "_notebooks"))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
