"""Templates and assets of the package, for Markdown and HTML."""

import base64
import hashlib
from collections.abc import Callable
from functools import lru_cache
from importlib.resources import files
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jinja2 import Environment


def environment(*, autoescape: bool, **filters: Callable[..., object]) -> "Environment":
    """Jinja environment on the templates of the package, with these filters."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    made = Environment(
        loader=PackageLoader("fitmodels.cards"),
        autoescape=autoescape,  # noqa: S701  in Markdown the filters escape
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    made.filters.update(filters)
    return made


@lru_cache(maxsize=8)
def asset(name: str) -> str:
    """Text of a file in the folder of templates."""
    return files("fitmodels.cards").joinpath("templates", name).read_text("utf-8")


def checksum(text: str) -> str:
    """SHA-256 in base64, as a content security policy states it."""
    return base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()
