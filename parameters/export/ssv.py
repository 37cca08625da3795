"""FMI: System Structure Parameter Values 1.0, every number as a Real with its unit declared in SI.

Schema: Modelica Association, System Structure and Parameterization 1.0 (2019), SystemStructureParameterValues.xsd. Its
``Unit`` needs the powers of SI base units; a unit without them would pass as a pure number, so it is not declared and
stands in the description alone.
"""

from html import escape

from .quantities import Quantity
from .si import Si, si
from .view import View

SSP = "http://ssp-standard.org/SSP1/SystemStructure"

CANNOT = (
    "units that are no product of SI base units, such as HRC: they stand in the description",
    "the covariance, the posterior and text of the laws: a parameter set holds values",
    "the tie to a model's own parameter names: that is a mapping (.ssm), written for the model",
    "arrays: coefficients are single parameters",
)


def render(view: View) -> str:
    """Give the parameter set."""
    units = {q.unit: found for q in view.quantities if (found := si(q.unit)) is not None}
    head = f'name="{_text(view.name)}" version="1.0" generationTool="{_text(view.made_by)}"'
    return "\n".join([
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<ssv:ParameterSet xmlns:ssv="{SSP}ParameterValues" xmlns:ssc="{SSP}Common"',
        f'    {head}',
        f'    description="{_text(_description(view))}">',
        "  <ssv:Parameters>",
        *(_parameter(q, q.unit in units) for q in view.quantities),
        "  </ssv:Parameters>",
        *_units(units),
        "</ssv:ParameterSet>",
        "",
    ])  # fmt: skip


def _description(view: View) -> str:
    return "; ".join((
        f"tool {view.tool}, work {view.work}, machine {view.machine}",
        *(("SIMULATED data, not measured",) if view.simulated else ()),
        f"parameter file {view.checksum}",
        *(f"assumed: {words}" for words in view.assumed),
        *(f"not carried: {words}" for words in CANNOT),
    ))  # fmt: skip


def _parameter(quantity: Quantity, declared: bool) -> str:
    unit = f' unit="{_text(quantity.unit)}"' if declared else ""
    return (
        f'    <ssv:Parameter name="{quantity.name}" description="{_text(f"{quantity.words}, in {quantity.unit}")}">'
        f'<ssv:Real value="{quantity.value!r}"{unit}/></ssv:Parameter>'
    )


def _units(units: dict[str, Si]) -> list[str]:
    if not units:
        return []
    return ["  <ssv:Units>", *(_unit(name, unit) for name, unit in units.items()), "  </ssv:Units>"]


def _unit(name: str, unit: Si) -> str:
    powers = "".join(f' {base}="{power}"' for base, power in unit.powers)
    return f'    <ssc:Unit name="{_text(name)}"><ssc:BaseUnit{powers} factor="{unit.factor!r}"/></ssc:Unit>'


def _text(text: str) -> str:
    """A value between double quotes."""
    return escape("".join(c if c.isprintable() else "_" for c in text), quote=True)
