"""Display of the results of this package: one registered function per class."""

import numpy as np

from ..core.display import Display, TextTable, display_of, estimates, facts_of
from ..core.rounding import format_plain, p_value, with_unit
from ..core.verdict import MARKS
from .budget import UncertaintyBudget
from .checks.report import CheckReport
from .draws import Draws
from .file import ParameterFile
from .sections.base import VerdictSection
from .sections.dynamics import DynamicsSection
from .sections.force_control import COEFFICIENTS, DriveSection
from .sections.law import LawSection
from .sections.law_parts import LawCheck

SECTIONS = (
    *("design", "tool_life", "posterior", "dynamics", "drive", "pi", "load_line", "limits", "costs"),
    "roughness",
    "adaptive_force",
)
PASSED = {True: "passed", False: "FAILED", None: "not tested"}


@display_of.register
def of_file(pf: ParameterFile) -> Display:
    """Tool and work, the laws with their verdicts, the sections present."""
    there = [name.replace("_", " ") for name in SECTIONS if getattr(pf, name) is not None]
    simulated = ", simulated" if pf.identity.simulated else ""
    laws = f"laws {', '.join(pf.laws)}" if pf.laws else "no laws"
    head = f"{pf.identity.tool} on {pf.identity.work}{simulated}: {'; '.join([laws, *there])}"
    rows = tuple((law.response, short_equation(law), f"n {law.n}", level_of(law.verdict)) for law in pf.laws.values())
    made = (("written with", f"fitmodels {pf.provenance.fitmodels}"),)
    doubts = () if pf.reading is None else tuple(f"Doubt about the data: {one.sentence}" for one in pf.reading.doubts)
    return Display(head, made, TextTable(("", "law", "", "verdict"), rows) if rows else None, doubts)


def short_equation(law: LawSection) -> str:
    """The equation with four digits per number."""
    first, *rest = (f"{value:.4g}" for value in law.coefficients.values())
    left = with_unit(law.response, law.unit)
    if law.form == "power":
        return " ".join([f"{left} = {first}", *(f"{f.symbol}^{k}" for f, k in zip(law.factors, rest, strict=True))])
    return law.equation


def level_of(verdict: VerdictSection | None) -> str:
    """The level of a verdict, its icon and its words; that it is not known where there is none."""
    return "not judged" if verdict is None else f"{MARKS[verdict.concern].icon} {verdict.level}"


def verdict_sentences(verdict: VerdictSection | None) -> tuple[str, ...]:
    """The verdict and its reasons; nothing of what was not judged."""
    return () if verdict is None else (f"Verdict: {level_of(verdict)}.", *verdict.reasons)


@display_of.register
def of_verdict(verdict: VerdictSection) -> Display:
    """The level; what was checked; the reasons."""
    return display_of(verdict.verdict)


@display_of.register
def of_law(law: LawSection) -> Display:
    """Equation, scatter and rows; coefficients with their standard errors; the verdict."""
    rows = f"{law.n} rows" + ("" if law.n_edges is None else f" of {law.n_edges} edges")
    se = "" if law.residual_se is None else f", residual SE {format_plain(law.residual_se, 3)} {law.residual_scale}"
    names = list(law.coefficients)
    grid = estimates(names, law.coefficients.values(), [law.standard_errors.get(name) for name in names])
    tested = tuple((f"tested {f.symbol}", f"{f.low:g} to {f.high:g} {f.unit}") for f in law.factors)
    sentences = dict.fromkeys((*verdict_sentences(law.verdict), *law.verdicts, *law.notes))
    return Display(f"{short_equation(law)}{se}, {rows}", tested, grid, tuple(sentences), checks_of(law))


def checks_of(law: LawSection) -> TextTable | None:
    """The checks of a law as on its card; None where it has none."""
    from ..fit.checks.check import BY_EDGE, check_table

    shown = {name: check for name, check in law.checks.items() if law.n_edges is not None or name not in BY_EDGE}
    return check_table(line_of_section(name, check) for name, check in shown.items()) if shown else None


def line_of_section(name: str, check: LawCheck) -> tuple[str, str, str, str]:
    """Title, statistic, p and verdict of a check of a parameter file."""
    from ..fit.checks.check import LEVELS, TITLES, UNTESTABLE, format_statistic, statistic_name

    title = TITLES.get(name, name.capitalize())
    if check.reason is not None:
        return title, "", "", UNTESTABLE
    symbol = statistic_name("statistic" if check.symbol is None else check.symbol, check.df, check.p)
    statistic = f"{symbol} = {format_statistic(check.statistic)}" if symbol and check.statistic is not None else ""
    return title, statistic, "" if check.p is None else p_value(check.p), LEVELS[min(check.concern, 2)]


@display_of.register
def of_check_report(report: CheckReport) -> Display:
    """Number of failed checks; each finding."""
    rows = tuple((finding.name, PASSED[finding.passed], finding.words) for finding in report.findings)
    failed = [finding.words for finding in report.failed]
    verdict = f"{len(failed)} failed: {failed[0]}" if failed else "no check failed"
    return Display(f"{len(report.findings)} findings, {verdict}", (), TextTable(("", "", ""), rows) if rows else None)


@display_of.register
def of_budget(budget: UncertaintyBudget) -> Display:
    """The result as the GUM states it; the contributions; what is not included."""
    return Display(budget.words, (), budget.table(), budget.notes)


@display_of.register
def of_draws(draws: Draws) -> Display:
    """Number of draws; mean, sd and interval of each parameter."""
    low, high = np.quantile(draws.values, [0.025, 0.975], axis=0)
    sd = draws.values.std(axis=0, ddof=1) if len(draws.values) > 1 else [None] * len(draws.names)
    grid = estimates(draws.names, draws.values.mean(axis=0), sd, list(low), list(high))
    return Display(f"{len(draws.values)} draws of {', '.join(draws.names)}", (), grid)


@display_of.register
def of_dynamics(model: DynamicsSection) -> Display:
    """Orders, gain and sample time; the other fields; the verdict."""
    below = sum(model.a)
    gain = f"gain {format_plain(sum(model.b) / below)}" if below else "an integrator"
    head = f"{model.input} to {model.output}, na {len(model.a) - 1}, nb {len(model.b) - model.nk}, nk {model.nk}"
    facts = tuple(fact for fact in facts_of(model) if fact[0] != "verdict")
    return Display(f"{head} at {model.sample_time:g} s, {gain}", facts, sentences=verdict_sentences(model.verdict))


@display_of.register
def of_drive(drive: DriveSection) -> Display:
    """Inertia and friction with their standard errors; the other fields; the verdict."""
    units = (drive.unit_inertia, drive.unit_viscous, drive.unit_force, drive.unit_force)
    values = [float(getattr(drive, name)) for name in COEFFICIENTS]
    shown = zip(COEFFICIENTS, values, units, strict=True)
    head = f"{drive.output} from {drive.input}: " + ", ".join(f"{n} {format_plain(v)} {unit}" for n, v, unit in shown)
    held = drive.uncertainty
    errors = dict(zip(held.of, np.sqrt(np.diag(held.matrix)), strict=True)) if held.kind == "covariance" else {}
    grid = estimates(COEFFICIENTS, values, [errors.get(name) for name in COEFFICIENTS])
    facts = tuple(fact for fact in facts_of(drive) if fact[0] not in ("verdict", *COEFFICIENTS))
    return Display(head, facts, grid, verdict_sentences(drive.verdict))
