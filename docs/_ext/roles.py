"""The recognized column names: ``{roles}`` lists them from the vocabulary."""

from typing import TYPE_CHECKING

from docutils import nodes
from docutils.parsers.rst import Directive

if TYPE_CHECKING:
    from sphinx.application import Sphinx

HEADS = {"symbol": 10, "quantity": 20, "unit": 10, "other names": 60}


class Roles(Directive):
    """A table of all roles."""

    def run(self) -> list[nodes.Node]:
        """The table."""
        from fitmodels.datasets.vocabulary import ROLES

        group = nodes.tgroup(cols=len(HEADS))
        group += [nodes.colspec(colwidth=width) for width in HEADS.values()]
        group += nodes.thead("", _row(*(nodes.Text(head) for head in HEADS)))
        body = nodes.tbody()
        for role in ROLES.values():
            also = ", ".join(dict.fromkeys(name for name in role.names if name not in (role.symbol, role.quantity)))
            body += _row(nodes.literal("", role.symbol), *map(nodes.Text, (role.quantity, role.unit, also)))
        group += body
        return [nodes.table("", group, classes=["schema"])]


def _row(*cells: nodes.Node) -> nodes.row:
    return nodes.row("", *(nodes.entry("", nodes.paragraph("", "", cell)) for cell in cells))


def setup(app: "Sphinx") -> dict[str, bool]:
    """Register ``{roles}``."""
    app.add_directive("roles", Roles)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
