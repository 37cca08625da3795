"""An ini file: key and value, the unit of each under the same key in a section of its own.

No value holds a ``%``, which Python's reader takes for a reference, so that unit is spelled ``percent``.
"""

from .view import View

CANNOT = (
    "structure: a law, a model and a loop are single numbers here",
    "the covariance, the posterior and text of the laws",
    "types: every value is text, numbers in 17 digits where they need them",
)


def render(view: View) -> str:
    """Give the ini file."""
    about = {
        "made_by": view.made_by, "parameter_file": view.checksum, "tool": view.tool, "work": view.work,
        "machine": view.machine, "simulated": "yes" if view.simulated else "no",
        **{f"assumed_{place}": words for place, words in enumerate(view.assumed, 1)},
        **{f"not_carried_{place}": words for place, words in enumerate(CANNOT, 1)},
    }  # fmt: skip
    return "\n".join((
        _section("about", about),
        _section("values", {q.name: repr(q.value) for q in view.quantities}),
        _section("units", {q.name: q.unit for q in view.quantities}),
        _section("words", {q.name: q.words for q in view.quantities}),
    ))  # fmt: skip


def _section(name: str, items: dict[str, str]) -> str:
    return f"[{name}]\n" + "".join(f"{key} = {_value(text)}\n" for key, text in items.items())


def _value(text: str) -> str:
    """One line that no reader takes for a comment, a reference or a continuation."""
    return " ".join(text.replace("%", "percent").replace(";", ",").replace("#", "_").split())
