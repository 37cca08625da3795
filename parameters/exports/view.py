"""The parameter file as a controller needs it: one typed view that every export is written from.

Loop and settings come from `loop`, numbers under safe names from `quantities`, text that cannot inject from `names`; a
file that fails the check is refused.
"""

from dataclasses import dataclass, replace
from typing import Final

from ...core.errors import GateError
from ..checks import check
from ..checks.record import record_notes
from ..checks.report import require_verdicts
from ..data_sources import data_lines
from ..file import ParameterFile, sealed
from ..file_format import content_sha256
from ..sections.law import LawSection
from ..setting_words import of_cut_lines, power_limit_words, window_assumed
from .loop import LoadLoop, loop_settings
from .names import plain, plain_equation, plain_lines, plain_unit, safe_name
from .quantities import Quantity, file_quantities

NO_SAFETY: Final = (
    "no safety function in the sense of ISO 13849 - drive limits, machine protection and emergency stop are needed",
)
NOT_DETECTED: Final = (
    "not detected - a load that falls to exactly the load in air is taken for air, the feed keeps its last value",
    "not detected - a reading in its valid range that drifts or is wrong by a factor, the tool load is then wrong too",
    "detected late - a reading that stands still below the reference, the feed rises at the rate recover until then",
)


@dataclass(frozen=True, slots=True)
class PlantModel:
    """The identified feed drive: polynomials in z^-1 as the file has them (b keeps its nk leading zeros)."""

    b: tuple[float, ...]
    a: tuple[float, ...]
    nk: int
    sample_time: float  # s
    unit_u: str
    unit_y: str


@dataclass(frozen=True, slots=True)
class TunedGains:
    """The PI as it was tuned, in the units of the dynamics: with `PlantModel` it closes the loop that was tuned.

    Forms and integration rules are those of `fitmodels.ident.pi.gains`.
    """

    kp: float  # plant.unit_u per plant.unit_y
    ki: float  # the same per second
    sample_time: float  # s
    form: str
    integration: str
    delay: int  # samples
    filter_time: float  # s
    average: int  # samples
    average_of: str
    unit_u: str
    unit_y: str
    low: float | None  # limits of the command, plant.unit_u, and of its change per second
    high: float | None
    rate: float | None
    anti_windup: str
    tracking_time: float | None  # s
    setpoint_weight: float


@dataclass(frozen=True, slots=True)
class ExportView:
    """View of a parameter file from which every export is written.

    ``tool``, ``work`` and ``machine`` are plain text already (see `names.plain`), ``name`` an identifier.
    ``file_quantities`` holds every number worth carrying, the loop's among them, in a fixed order.
    ``assumed`` lists the settings that the file lacks, with the value assumed for each; ``verdicts`` are lines on the
    laws, dynamics and force process that are not usable without reservations, with the reasons; ``equations`` are those
    of the laws, for people: a program computes with the quantities; ``data`` are lines on the data files, on what
    was corrected or left out in them and on a power that is computed from a force; ``basis`` are lines on what the
    settings of the control come from.
    """

    name: str
    tool: str
    work: str
    machine: str
    simulated: bool | None
    made_by: str  # "fitmodels 0.1.0"
    checksum: str  # SHA-256 of the parameter file's content
    loop: LoadLoop | None
    gains: TunedGains | None
    plant: PlantModel | None
    quantities: tuple[Quantity, ...]
    assumed: tuple[str, ...]
    verdicts: tuple[str, ...] = ()
    equations: tuple[str, ...] = ()
    data: tuple[str, ...] = ()
    basis: tuple[str, ...] = ()

    @property
    def origin(self) -> tuple[str, ...]:
        """Lines that state the pair, whether the data are simulated, the verdicts, and the parameter file."""
        unknown = ("not known whether the data were measured or SIMULATED",) if self.simulated is None else ()
        simulated = ("SIMULATED data, not measured",) if self.simulated else unknown
        pair = f"tool {self.tool}, work {self.work}, machine {self.machine}"
        return (pair, *simulated, *self.data, *self.verdicts, f"parameter file {self.checksum}")

    def remarks(self, not_carried: tuple[str, ...], *, safety: bool = True) -> tuple[str, ...]:
        """Lines on the limits of use, on what was assumed and on what the format cannot carry.

        Without ``safety`` the head states in its first lines that it is no safety function.
        """
        assumed = (f"assumed: {words}" for words in self.assumed)
        limits = (line for line in self.limits_of_use if safety or line not in NO_SAFETY)
        return (*limits, *assumed, *(f"not included: {words}" for words in not_carried))

    @property
    def limits_of_use(self) -> tuple[str, ...]:
        """Lines that every export carries: it is no safety function, and what a loop with these gains cannot detect."""
        return NO_SAFETY if self.gains is None and self.loop is None else (*NO_SAFETY, *NOT_DETECTED)


def export_view(pf: ParameterFile, *, accept_verdict: bool = False, loop_only: bool = False) -> ExportView:
    """The view of a parameter file.

    Parameters
    ----------
    pf : ParameterFile
    accept_verdict : bool
        Export parts that must not be used for control, or have no verdict; the view names them.
    loop_only : bool
        The format carries the loop, and of the laws uses the one that its limits come from.

    Raises
    ------
    GateError
        The file fails the check; a part that is exported must not be used for control or has no verdict.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> seen = export_view(parameters.collect(tool="../../x", work="709M40", laws=[]))
    >>> seen.name, seen.tool, seen.loop
    ('x_n709m40', '.._.._x', None)
    """
    untried = require_check(pf)
    held = require_verdicts(pf, accept_verdict, loop_only=loop_only)
    verdicts = tuple(line for words in held for line in plain_lines(words))
    doubts = () if pf.reading is None else pf.reading.doubts
    doubted = (_in_full(f"the data are right although the reading doubts them: {doubt.sentence}") for doubt in doubts)
    found, who = loop_settings(pf, own_form=True), pf.identity
    return ExportView(
        name=safe_name(f"{safe_name(who.tool, 'tool')}_{safe_name(who.work, 'work')}"),
        tool=plain(who.tool), work=plain(who.work), machine=plain(who.machine or "not named"), simulated=who.simulated,
        made_by=plain(f"fitmodels {pf.provenance.fitmodels}"),
        checksum=pf.content_sha256 or content_sha256(pf.model_dump()),
        loop=found.loop, verdicts=verdicts, gains=_gains(pf), plant=_plant(pf),
        equations=tuple(_equation(law) for law in pf.laws.values()),
        quantities=file_quantities(pf, found.loop), assumed=(*doubted, *untried, *found.assumed),
        data=(*data_lines(pf), *_of_power(pf)), basis=_basis(pf),
    )  # fmt: skip


def view_of_laws(pf: ParameterFile, used: tuple[str, ...], accept_verdict: bool) -> ExportView:
    """The view of a file with no part but these laws, so that verdicts of other parts do not count.

    Raises
    ------
    GateError
        One of the laws must not be used for control, or has no verdict.
    """
    held = require_verdicts(pf, accept_verdict, only=used)
    lines = tuple(line for words in held for line in plain_lines(words))
    parts = ("dynamics", "pi", "load_line", "drive", "adaptive_force", "roughness")
    laws = {name: law for name, law in pf.laws.items() if name in used}
    alone = sealed(pf, **dict.fromkeys(parts), laws=laws)
    checksum = pf.content_sha256 or content_sha256(pf.model_dump())
    return replace(export_view(alone, accept_verdict=True), verdicts=lines, checksum=checksum)


def first_lines(view: ExportView, loop: LoadLoop, *of_limits: str) -> tuple[str, ...]:
    """Lines below the title of every exported control; ``of_limits`` are further ones on the limits."""
    safety = (f"{words[0].upper()}{words[1:]}." for words in NO_SAFETY)
    return (*safety, _fault_words(loop), _limit_words(loop), *of_limits, *view.basis)


def _fault_words(loop: LoadLoop) -> str:
    """Effect of a fault, and of constant load the choice."""
    if loop.stop_on_fault:
        return "On a fault the feed stops: --on-fault stop was chosen."
    choice = "; to stop: fitmodels settings --on-fault stop" if loop.law == "pi" else ""
    return f"On a fault the feed falls to its lower limit and the cut goes on{choice}."


def _limit_words(loop: LoadLoop) -> str:
    """Reference and feed limits in the units of the machine, and as shares of the programmed feed."""
    return (
        f"Load {loop.reference:.6g} {loop.unit_load}; feed {loop.feed_low:.4g} to {loop.feed_high:.4g} "
        f"{loop.unit_feed}, {loop.low:.4g} to {loop.high:.4g} of the programmed {loop.feed_programmed:.6g} "
        f"{loop.unit_feed}."
    )


def _basis(pf: ParameterFile) -> tuple[str, ...]:
    """Lines on what a control comes from: load limit, tool change, tested ranges of its law, and what gains meet."""
    line, pi = pf.load_line, pf.pi
    sentences = []
    if line is not None:
        assumed = ", assumed" if window_assumed(line) else ""
        unit = plain_unit(line.unit_load)
        sentences = [
            f"Load limit of a worn tool {line.worn:g} {unit}, safety factor {line.safety_factor:g}.",
            f"Tool change at a wear of {line.window[0]:g} to {line.window[1]:g} {plain_unit(line.unit_wear)}{assumed}.",
        ]
        if line.probability is not None:
            share = f"{100 * line.probability:.0f} %"
            sentences.append(
                f"Of further tools, {share} have a wear in it when they reach the lower feed limit, by the law."
            )
        sentences += [_tested(pf.laws[line.law])] if line.law in pf.laws else []
    if pi is not None and pi.probability is not None and pi.specification is not None:
        asked = pi.specification
        times = ((name, getattr(asked, f"{name}_time")) for name in ("rise", "settling"))
        limits = [f"{name} time {limit:g} s" for name, limit in times if limit is not None]
        limits += [] if asked.overshoot is None else [f"overshoot {100 * asked.overshoot:g} %"]
        share = f"{100 * pi.probability:.0f} % over the uncertainty of the dynamics"
        sentences.append(f"Gains for {', '.join(limits)}, with probability {share}.")
        sentences += [note for note in pi.notes if note.startswith("Scaling ")]
    return tuple(_in_full(words) for words in sentences)


def _of_power(pf: ParameterFile) -> tuple[str, ...]:
    """A line on a power that was computed from the force, and its limit."""
    limited = power_limit_words(pf.limits, pf.laws, pf.costs)
    return tuple(line for words in limited or of_cut_lines(pf.laws) for line in plain_lines(words))


def _in_full(words: str) -> str:
    """A sentence for a comment, not shortened."""
    return " ".join(plain_lines(words))


def _tested(law: LawSection) -> str:
    """The ranges in which the law of the feed limits was tested."""
    ranges = (
        f"{one.quantity or one.symbol} {one.low:.4g} to {one.high:.4g} {plain_unit(one.unit)}" for one in law.factors
    )
    return f"The law of {law.response} was tested at {', '.join(ranges)}."


def _equation(law: LawSection) -> str:
    """The equation at six digits, at the reference level, with the units of its quantities."""
    right = law.formula.equation([f"{law.coefficients[name]:.6g}" for name in law.coefficient_names])
    units = "; ".join(f"{f.symbol} in {f.unit or '1'}" for f in law.factors)
    level = "" if law.by is None else f"; at {law.by.column} {law.by.reference}, others by their shift"
    return plain_equation(f"{law.response} = {right}; {law.response} in {law.unit or '1'}; {units}{level}")


def _gains(pf: ParameterFile) -> TunedGains | None:
    pi, model = pf.pi, pf.dynamics
    if pi is None:
        return None
    by = pi.scaling_y / pi.scaling_u  # of the dynamics' units
    low, high, rate = (None if value is None else value / pi.scaling_u for value in (pi.low, pi.high, pi.rate))
    unit_u, unit_y = (pi.unit_u, pi.unit_y) if model is None else (model.unit_u, model.unit_y)
    return TunedGains(
        kp=pi.kp * by, ki=pi.ki * by, sample_time=pi.sample_time, form=pi.form, integration=pi.integration,
        delay=pi.delay, filter_time=pi.filter_time, average=pi.average, average_of=pi.average_of,
        unit_u=plain_unit(unit_u), unit_y=plain_unit(unit_y), low=low, high=high, rate=rate,
        anti_windup=pi.anti_windup, tracking_time=pi.tracking_time, setpoint_weight=pi.setpoint_weight,
    )  # fmt: skip


def _plant(pf: ParameterFile) -> PlantModel | None:
    model = pf.dynamics
    if model is None:
        return None
    return PlantModel(model.b, model.a, model.nk, model.sample_time, plain_unit(model.unit_u), plain_unit(model.unit_y))


def require_check(pf: ParameterFile) -> tuple[str, ...]:
    """Raise unless the file passes the check, verdicts apart; returns assumptions about what was not checked.

    Raises
    ------
    GateError
        The file fails the check.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> require_check(parameters.collect(tool="GC435", work="709M40", laws=[]))
    ()
    """
    failed = check(pf).inconsistent
    if failed:
        first, *others = failed
        more = f" {len(others)} more: see `fitmodels check`." if others else ""
        raise GateError(f"not exported, the file fails the check: {first.words}{more}")
    return _not_checked(pf)


def _not_checked(pf: ParameterFile) -> tuple[str, ...]:
    """Assumptions of an export because the file does not hold what would show it."""
    line, pi = pf.load_line, pf.pi
    unknown = line is not None and line.law not in pf.laws
    untried = pi is not None and pf.dynamics is None
    forced = pi is not None and pi.forced is not None
    noted = () if pi is None else record_notes(pf)
    apart = (words.partition(": if")[0].replace("'", "") for words in noted)
    return (
        *(("the feed limits are right: the law that they come from is not in the file",) if unknown else ()),
        *(("the gains are right: the file holds no dynamics to try them on",) if untried else ()),
        *(("the gains will do although they miss their specification: they are marked as forced",) if forced else ()),
        *(_in_full(f"the dynamics are those of a cut: {words}") for words in apart),
    )
