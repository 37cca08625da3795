"""FMU: the controller in C behind FMI 2.0 for co-simulation, as sources that the importing tool compiles.

Standard: Functional Mock-up Interface for Model Exchange and Co-Simulation 2.0.4, Modelica Association 2022. The tool
brings the header files of the standard, as it demands.
"""

from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Final
from uuid import NAMESPACE_URL, uuid5
from zipfile import ZipFile, ZipInfo

from ...parameters.exports.loop import LoadLoop
from ...parameters.exports.ssv import si_unit, xml_text
from ...parameters.exports.view import ExportView
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
    """A variable of the FMU: member of the input or output in C, its causality, type, number, start value and unit."""

    name: str
    causality: str
    kind: str
    reference: int
    words: str
    start: str = ""
    unit: str = ""


def _variables(loop: LoadLoop) -> tuple[Variable, ...]:
    """The variables; their names are those of ``LoadInput`` and ``LoadOutput``."""
    load, feed, low = loop.unit_load, loop.unit_feed, repr(loop.low)
    out = "output"
    return (
        Variable("load", "input", "Real", 0, "reading of the sensor", "0.0", load),
        Variable("requested", "input", "Real", 1, "feed of the program times an operator above 1; 0 at rest",
                 repr(loop.feed_programmed), feed),
        Variable("enable", "input", "Boolean", 0, "the switch of the operator", "false"),
        Variable("spindle_on", "input", "Boolean", 1, "the spindle turns", "false"),
        Variable("idle", "input", "Boolean", 2, "the path does not advance", "false"),
        Variable("beat", "input", "Boolean", 3, "changes while the source of the load is alive", "false"),
        Variable("reset", "input", "Boolean", 4, "a rising edge clears what is latched unless its cause is present",
                 "false"),
        Variable("slowed", "input", "Boolean", 5, "operator below 1, or path over 5 % slower than commanded: no rise",
                 "true"),
        Variable("feed_override", out, "Real", 10, "factor of the requested feed", low, "1"),
        Variable("u", out, "Real", 11, "feed over programmed feed", low, "1"),
        Variable("measured", out, "Real", 12, "filtered load", "0.0", load),
        Variable("state", out, "Integer", 0, "0 off, 1 air, 2 entry, 3 control, 4 worn, 5 fault", "0"),
        Variable("cause", out, "Integer", 1,
                 "of the fault: 1 load lost, 2 stuck, 3 no heartbeat, 4 requested, 5 period", "0"),
        Variable("fault", out, "Boolean", 10, "latched: see cause", "false"),
        Variable("worn", out, "Boolean", 11, "latched: change the tool", "false"),
        Variable("overload", out, "Boolean", 12, "latched: mean load above what a worn tool withstands", "false"),
        Variable("feed_inhibit", out, "Boolean", 13, "stop the feed", "false"),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class ControlSource:
    """A controller in C as an interface calls it: its text, names and period.

    Attributes
    ----------
    model : str
        Name of the model, an identifier of C.
    text : str
        The C source with the settings.
    prefix : str
        Of the types ``State``, ``Input`` and ``Output``: ``Load``.
    init, step : str
        Calls in C with ``x``, ``in`` and ``out`` as pointers to these: ``load_control_init(&load_settings, x)``.
    period : str
        Expression in C of the period of the calls, s.
    sample_time : float
        The same as a number.
    """

    model: str
    text: str
    prefix: str
    init: str
    step: str
    period: str
    sample_time: float


def fmu_file(control: GatedControl) -> bytes:
    """Content of the FMU of the load controller."""
    loop = control.loop
    source = ControlSource(
        MODEL, c_file(control), "Load", "load_control_init(&load_settings, x)",
        "load_control_step(&load_settings, x, in, out)", "load_settings.sample_time", loop.sample_time,
    )  # fmt: skip
    about = "; ".join(c_head(control, NOT_IN_FMU))
    return fmu_archive(control.view, source, _variables(loop), about, key=c_controller(loop))


def fmu_archive(
    view: ExportView, source: ControlSource, variables: tuple[Variable, ...], about: str, key: str = ""
) -> bytes:
    """An FMU, an uncompressed zip archive; the same control gives the same bytes with every zlib.

    Parameters
    ----------
    view : ExportView
        Of the parameter file.
    source : ControlSource
    variables : tuple of Variable
        Inputs and outputs of a step; ``period`` is set by the interface.
    about : str
        Description of the model.
    key : str
        What another control differs in; by default the C text.
    """
    guid = f"{{{uuid5(NAMESPACE_URL, view.checksum + (key or source.text))}}}"
    interface = Path(__file__).with_name("fmi2.c").read_text("ascii")
    files = {
        "modelDescription.xml": _description(view, source, variables, about, guid),
        "sources/controller.c": source.text,
        "sources/fmi2.c": f"{_definitions(source, variables, guid)}{interface}",
    }
    out = BytesIO()
    with ZipFile(out, "w") as archive:
        for name, text in files.items():
            entry = ZipInfo(name, (1980, 1, 1, 0, 0, 0))
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, text)
    return out.getvalue()


def _definitions(source: ControlSource, variables: tuple[Variable, ...], guid: str) -> str:
    """Definitions of a controller for ``fmi2.c``: its name, calls and variables."""
    values = {"false": "0", "true": "1"}
    places = {"input": "in", "output": "out"}
    starts = " ".join(f"now.{places[v.causality]}.{v.name} = {values.get(v.start, v.start)};" for v in variables)
    lists = "".join(
        f"#define {kind.upper()}S(INPUT, OUTPUT){''.join(f' {_listed(v)}' for v in variables if v.kind == kind)}\n"
        for kind in ("Real", "Integer", "Boolean")
    )
    return (
        f'#define FMU_GUID "{guid}"\n#include "fmi2Functions.h"\n#include "controller.c"\n\n'
        f'#define CONTROL_NAME "{source.model}"\n#define CONTROL_PERIOD {source.period}\n'
        f"#define CONTROL_INIT(x) {source.init}\n#define CONTROL_STEP(x, in, out) {source.step}\n"
        f"#define CONTROL_START(now) {starts}\n{lists}"
        + "".join(f"typedef {source.prefix}{name} Control{name};\n" for name in ("State", "Input", "Output"))
        + "\n"
    )


def _listed(variable: Variable) -> str:
    return f"{variable.causality.upper()}({variable.reference}, {variable.name})"


def _description(
    view: ExportView, source: ControlSource, variables: tuple[Variable, ...], about: str, guid: str
) -> str:
    outputs = [place for place, v in enumerate(variables, 1) if v.causality == "output"]
    unknowns = "".join(f'      <Unknown index="{place}"/>\n' for place in outputs)
    return (
        '<?xml version="1.0" encoding="UTF-8"?>\n'
        f'<fmiModelDescription fmiVersion="2.0" modelName="{source.model}" guid="{guid}" version="{view.checksum}"\n'
        f'    generationTool="{xml_text(view.made_by)}" variableNamingConvention="flat"\n'
        f'    description="{xml_text(about)}">\n'
        f'  <CoSimulation modelIdentifier="{source.model}" canHandleVariableCommunicationStepSize="false"\n'
        '      canGetAndSetFMUstate="true" canSerializeFMUstate="true" canNotUseMemoryManagementFunctions="true">\n'
        '    <SourceFiles><File name="fmi2.c"/></SourceFiles>\n  </CoSimulation>\n'
        f"{_units(variables)}"
        '  <LogCategories><Category name="logStatusError"/></LogCategories>\n'
        f'  <DefaultExperiment startTime="0.0" stepSize="{source.sample_time!r}"/>\n'
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
            lines += f'    <Unit name="{xml_text(name)}"><BaseUnit{powers} factor="{found.factor!r}"/></Unit>\n'
    return f"  <UnitDefinitions>\n{lines}  </UnitDefinitions>\n" if lines else ""


def _variable(variable: Variable) -> str:
    v, known = variable, si_unit(variable.unit) is not None if variable.unit else False
    initial = ' initial="exact"' if v.causality == "output" else ""
    discrete = "" if v.kind == "Real" and v.causality == "input" else ' variability="discrete"'
    unit = f' unit="{xml_text(v.unit)}"' if known else ""
    words = f"{v.words}, in {v.unit}" if v.unit and not known else v.words
    return (
        f'    <ScalarVariable name="{v.name}" valueReference="{v.reference}" causality="{v.causality}"'
        f'{discrete}{initial} description="{xml_text(words)}"><{v.kind} start="{v.start}"{unit}/></ScalarVariable>\n'
    )
