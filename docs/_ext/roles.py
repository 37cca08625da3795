"""Tables of the reading: ``{roles}`` lists the recognized column names, ``{ranges}`` the plausible values."""

from typing import TYPE_CHECKING

from docutils import nodes
from docutils.parsers.rst import Directive

if TYPE_CHECKING:
    from sphinx.application import Sphinx

HEADS = {"symbol": 10, "quantity": 20, "unit": 10, "other names": 60}


RANGES = {"symbol": 10, "unit": 10, "turning": 15, "milling": 15, "drilling": 15, "grinding": 15, "refused above": 15}


class Roles(Directive):
    """A table of all roles."""

    def run(self) -> list[nodes.Node]:
        """The table."""
        from fitmodels.datasets.vocabulary import ROLES

        rows = []
        for role in ROLES.values():
            also = ", ".join(dict.fromkeys(name for name in role.names if name not in (role.symbol, role.quantity)))
            rows.append(_row(nodes.literal("", role.symbol), *map(nodes.Text, (role.quantity, role.unit, also))))
        return [_table(HEADS, rows)]


class Ranges(Directive):
    """A table of the usual values of each quantity by process, and of the value above which it is refused."""

    def run(self) -> list[nodes.Node]:
        """The table."""
        from fitmodels.datasets.plausibility.ranges import plausible
        from fitmodels.datasets.vocabulary import ROLES

        rows = []
        for role in ROLES.values():
            unknown = plausible(role.symbol, None)
            if unknown is None:
                continue
            found = [plausible(role.symbol, process) for process in ("turning", "milling", "drilling", "grinding")]
            usual = ["{:g} to {:g}".format(*one.usual) if one else "" for one in found]
            cells = (role.unit, *usual, f"{unknown.hard[1]:.10g}")
            rows.append(_row(nodes.literal("", role.symbol), *map(nodes.Text, cells)))
        return [_table(RANGES, rows)]


def _table(heads: dict[str, int], rows: list[nodes.row]) -> nodes.table:
    group = nodes.tgroup(cols=len(heads))
    group += [nodes.colspec(colwidth=width) for width in heads.values()]
    group += nodes.thead("", _row(*(nodes.Text(head) for head in heads)))
    group += nodes.tbody("", *rows)
    return nodes.table("", group, classes=["schema"])


def _row(*cells: nodes.Node) -> nodes.row:
    return nodes.row("", *(nodes.entry("", nodes.paragraph("", "", cell)) for cell in cells))


def setup(app: "Sphinx") -> dict[str, bool]:
    """Register ``{roles}`` and ``{ranges}``."""
    app.add_directive("roles", Roles)
    app.add_directive("ranges", Ranges)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
