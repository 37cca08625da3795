"""What ``fitmodels ident`` prints: the model, how it was chosen, and how far it may be trusted."""

from typing import TYPE_CHECKING

from rich.console import Group, RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ..parameters import ParameterFile
from .content.coefficients import between, model_coefficients
from .dynamics_facts import model_words, transfer_function_words

if TYPE_CHECKING:
    from ..ident.identification import Identification


def block(found: "Identification", pf: ParameterFile) -> RenderableType:
    """Everything about one identification."""
    d = pf.dynamics
    assert d is not None  # noqa: S101  collected from a model
    rec = found.record
    runs = f", {len(rec.starts)} stretches" if len(rec.starts) > 1 else ""
    head = Text(f"{d.output} from {d.input}", style="bold")
    head.append(f"   {len(rec)} samples at {rec.rate:g} Hz{runs}", style="not bold")
    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="dim")
    for name in ("", "estimate", "SE", "95 % interval"):
        table.add_column(name, justify="right" if name else "left", no_wrap=True)
    for c in model_coefficients(d):
        table.add_row(c.name, c.estimate.text, c.se.text, between(c.low, c.high))
    lines = [*model_words(d), found.argument, *found.verdicts]
    words = [Text(line if line.endswith(".") else f"{line}.") for line in lines]
    return Group(head, Padding(Group(Text(transfer_function_words(d)), table, *words), (0, 0, 1, 2)))
