"""Formulas as MathML, which browsers render without a script, so that the pages can be read offline."""

from typing import TYPE_CHECKING

from docutils import nodes
from docutils.utils.math import pick_math_environment, wrap_math_code
from docutils.utils.math.latex2mathml import tex2mathml

if TYPE_CHECKING:
    from sphinx.application import Sphinx
    from sphinx.writers.html5 import HTML5Translator


def _inline(self: "HTML5Translator", node: nodes.math) -> None:
    self.body.append(tex2mathml(node.astext()))
    raise nodes.SkipNode


def _display(self: "HTML5Translator", node: nodes.math_block) -> None:
    code = node.astext()
    whole = wrap_math_code(code, as_block=True) if pick_math_environment(code) else code
    anchor = f' id="{node["ids"][0]}"' if node.get("ids") else ""
    self.body.append(f'<div class="math"{anchor}>{tex2mathml(whole, as_block=True)}</div>')
    raise nodes.SkipNode


def setup(app: "Sphinx") -> dict[str, bool]:
    """Register the renderer ``mathml``."""
    app.add_html_math_renderer("mathml", inline_renderers=(_inline, None), block_renderers=(_display, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
