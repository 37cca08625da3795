"""FMU: the controller in C behind FMI 2.0 for co-simulation, as sources that the importing tool compiles.

Standard: Functional Mock-up Interface for Model Exchange and Co-Simulation 2.0.4, Modelica Association 2022. The tool
brings the header files of the standard, as it demands.
"""

from dataclasses import dataclass
from html import escape
from io import BytesIO
from pathlib import Path
from typing import Final
from uuid import NAMESPACE_URL, uuid5
from zipfile import ZipFile, ZipInfo

from ...parameters.exports.loop import LoadLoop
from ...parameters.exports.ssv import si_unit
from ..gate import GatedControl
from .c_source import c_controller, c_file, c_head

NOT_IN_FMU = (
    "binaries: the importing tool compiles the sources, or `fmpy compile` does",
    "steps other than the sample time: such a step is refused",
    "the gains as parameters: they are constants, as in the machine",
    "the laws and their covariance, the posterior and the dynamics",
)
MODEL: Final = "fm_control"


@dataclass(frozen=True, slots=True)
class Variable:
    """A variable of the FMU: causality ``input`` or ``output``, type, number in it, start value or none, unit."""

    name: str
    causality: str
    kind: str
    reference: int
    words: str
    start: str = ""
    unit: str = ""


def _variables(loop: LoadLoop) -> tuple[Variable, ...]:
    """The variables; their numbers are those of ``fmi2.c``."""
    load, feed, low = loop.unit_load, loop.unit_feed, repr(loop.low)
    out = "output"
    return (
        Variable("load", "input", "Real", 0, "reading of the sensor", "0.0", load),
        Variable("requested", "input", "Real", 1, "feed of program and operator before this override; 0 at rest",
                 repr(loop.feed_programmed), feed),
        Variable("enable", "input", "Boolean", 0, "the switch of the operator", "false"),
        Variable("spindle_on", "input", "Boolean", 1, "the spindle turns", "false"),
        Variable("idle", "input", "Boolean", 2, "the path does not advance", "false"),
        Variable("beat", "input", "Boolean", 3, "changes while the source of the load is alive", "false"),
        Variable("reset", "input", "Boolean", 4, "a rising edge clears what is latched unless its cause is present",
                 "false"),
        Variable("feed_override", out, "Real", 10, "factor of the requested feed", low, "1"),
        Variable("u", out, "Real", 11, "feed over programmed feed", low, "1"),
        Variable("measured", out, "Real", 12, "filtered load", "0.0", load),
        Variable("state", out, "Integer", 0, "0 off, 1 air, 2 entry, 3 control, 4 worn, 5 fault", "0"),
        Variable("cause", out, "Integer", 1, "of the fault: 1 load lost, 2 stuck, 3 no heartbeat, 4 requested", "0"),
        Variable("fault", out, "Boolean", 10, "latched: see cause", "false"),
        Variable("worn", out, "Boolean", 11, "latched: change the tool", "false"),
        Variable("overload", out, "Boolean", 12, "latched: mean load above what a worn tool withstands", "false"),
        Variable("feed_inhibit", out, "Boolean", 13, "stop the feed", "false"),
    )  # fmt: skip


def fmu_file(control: GatedControl) -> bytes:
    """Content of the FMU, an uncompressed zip archive; the same control gives the same bytes with every zlib."""
    guid = f"{{{uuid5(NAMESPACE_URL, control.view.checksum + c_controller(control.loop))}}}"
    interface = Path(__file__).with_name("fmi2.c").read_text("ascii")
    files = {
        "modelDescription.xml": _description(control, guid),
        "sources/controller.c": c_file(control),
        "sources/fmi2.c": f'#define FMU_GUID "{guid}"\n{interface}',
    }
    out = BytesIO()
    with ZipFile(out, "w") as archive:
        for name, text in files.items():
            entry = ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, text)
    return out.getvalue()


def _description(control: GatedControl, guid: str) -> str:
    loop, variables = control.loop, _variables(control.loop)
    outputs = [place for place, v in enumerate(variables, 1) if v.causality == "output"]
    unknowns = "".join(f'      <Unknown index="{place}"/>\n' for place in outputs)
    about = _text("; ".join(c_head(control, NOT_IN_FMU)))
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<fmiModelDescription fmiVersion="2.0" modelName="{MODEL}" guid="{guid}" version="{control.view.checksum}"\n'
        f'    generationTool="{_text(control.view.made_by)}" variableNamingConvention="flat"\n'
        f'    description="{about}">\n'
        f'  <CoSimulation modelIdentifier="{MODEL}" canHandleVariableCommunicationStepSize="false"\n'
        '      canGetAndSetFMUstate="true" canSerializeFMUstate="true" canNotUseMemoryManagementFunctions="true">\n'
        '    <SourceFiles><File name="fmi2.c"/></SourceFiles>\n  </CoSimulation>\n'
        f"{_units(variables)}"
        '  <LogCategories><Category name="logStatusError"/></LogCategories>\n'
        f'  <DefaultExperiment startTime="0.0" stepSize="{loop.sample_time!r}"/>\n'
        f"  <ModelVariables>\n{''.join(map(_variable, variables))}  </ModelVariables>\n"
        f"  <ModelStructure>\n    <Outputs>\n{unknowns}    </Outputs>\n  </ModelStructure>\n"
        "</fmiModelDescription>\n"
    )


def _units(variables: tuple[Variable, ...]) -> str:
    lines = ""
    for name in dict.fromkeys(v.unit for v in variables if v.unit):
        found = si_unit(name)
        if found is not None:
            powers = "".join(f' {base}="{power}"' for base, power in found.powers)
            lines += f'    <Unit name="{_text(name)}"><BaseUnit{powers} factor="{found.factor!r}"/></Unit>\n'
    return f"  <UnitDefinitions>\n{lines}  </UnitDefinitions>\n" if lines else ""


def _variable(variable: Variable) -> str:
    v, known = variable, si_unit(variable.unit) is not None if variable.unit else False
    initial = ' initial="exact"' if v.causality == "output" else ""
    discrete = "" if v.kind == "Real" and v.causality == "input" else ' variability="discrete"'
    unit = f' unit="{_text(v.unit)}"' if known else ""
    words = f"{v.words}, in {v.unit}" if v.unit and not known else v.words
    return (
        f'    <ScalarVariable name="{v.name}" valueReference="{v.reference}" causality="{v.causality}"'
        f'{discrete}{initial} description="{_text(words)}"><{v.kind} start="{v.start}"{unit}/></ScalarVariable>\n'
    )


def _text(text: str) -> str:
    """A value between double quotes."""
    return escape("".join(c if c.isprintable() else "_" for c in text), quote=True)
