"""Collection of results into a parameter file, one section for each."""

import platform
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import PurePath, PureWindowsPath
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy
from pydantic import JsonValue, ValidationError

from ..core.errors import ParameterError
from ..core.version import __version__
from .file import ParameterFile, sealed
from .gather.control import Gains, as_data, dynamics_section, limits_section, pi_section
from .gather.design import criterion_of, design_section, reading_section
from .gather.law import laws_by_response
from .gather.lives import tool_life_section
from .gather.posterior import posterior_section
from .messages import schema_message
from .sections.load_line import LimitsSection

if TYPE_CHECKING:
    from ..datasets import Runs
    from ..fit import LawFit, NotAvailable
    from ..fit.bayes.posterior import Posterior
    from ..fit.fitted_rows import LawSource
    from ..fit.life import ToolLife
    from ..ident.identification import Identification
    from ..ident.model import Model
    from .sections.dynamics import DynamicsSection
    from .sections.force_control import AdaptiveForceSection, RoughnessSection
    from .sections.load_line import LoadLineSection
    from .sections.origin import DesignSection, Sensor


def collect(
    *,
    tool: str | None = None,
    work: str | None = None,
    design: "Runs | DesignSection | Mapping[str, Any] | None" = None,
    laws: "Sequence[LawFit]" = (),
    tool_life: "ToolLife | None" = None,
    posteriors: Sequence["Posterior"] = (),
    no_posterior: "Mapping[str, NotAvailable] | None" = None,
    draws_kept: bool = True,
    complete: bool = True,
    gauge_sd: float | None = None,
    dynamics: "Identification | Model | DynamicsSection | Mapping[str, Any] | None" = None,
    held_out_fit: float | None = None,
    pi: "Gains | None" = None,
    scaling_u: float = 1.0,
    pi_forced: str | None = None,
    load_line: "LoadLineSection | Mapping[str, Any] | None" = None,
    limits: "LimitsSection | Mapping[str, Any] | None" = None,
    roughness: "RoughnessSection | Mapping[str, Any] | None" = None,
    adaptive_force: "AdaptiveForceSection | Mapping[str, Any] | None" = None,
    machine: str | None = None,
    iso513: str | None = None,
    iso13399: Mapping[str, float | str] | None = None,
    setup: str | None = None,
    sensors: "Sequence[Sensor | Mapping[str, Any]]" = (),
    simulated: bool | None = None,
    note: str | None = None,
    data_file: str | PurePath | None = None,
    data_sha256: str | None = None,
    n_rows: int | None = None,
    created: str | None = None,
    command: str | None = None,
    options: Mapping[str, JsonValue] | None = None,
    seed: int | None = None,
    **more: object,
) -> ParameterFile:
    """Gather results into a parameter file.

    Parameters
    ----------
    tool, work, machine, iso513, iso13399, setup, sensors, note
        See `IdentitySection`; tool and work are needed without laws, the machine is by default that of the notes.
    design : Runs, optional
        The tests behind the laws, or their section; the doubts about them are those of the runs.
    laws : sequence of LawFit
        At most one for each response. Tool, work, data file, checksum, rows, simulated and note are taken from their
        source where they are not given. A published law of this tool and work is compared with each.
    tool_life : ToolLife, optional
        Solved from one of the laws.
    posteriors : sequence of PosteriorSection
        At most one for each response, of one seed, with passed convergence checks.
    no_posterior : mapping of str to NotAvailable, optional
        Reasons of responses without one.
    draws_kept : bool
        Whether their draws will be in a file next to this one, whose name and checksum are then recorded.
        Without it the section is complete but for the draws, which its seed makes again.
    complete : bool
        False leaves out the section of the posteriors and the checksum, which `completed` adds: laws with their
        verdicts, tool life and predictions are known a quarter of the time before.
    gauge_sd : float, optional
        Standard deviation of the wear gauge, in the unit of the wear.
    dynamics : Identification or Model, optional
        An identification brings its verdict; a model alone has none, and `export` refuses its file.
        ``held_out_fit`` is the per cent of another record that it explains.
    pi : PiGains or TunedPi, optional
        ``scaling_u`` is the number of its command's units in one of the model's input; ``pi_forced`` says why gains
        that miss their specification are kept.
    load_line, limits, roughness, adaptive_force : section or mapping, optional
        ``adaptive_force`` may hold the ``verdict`` of its `ForceProcess`. In ``limits`` a bare number or pair is in kW,
        N, mm, mm/rev, mm/min, m/min or 1/min.
    simulated : bool
        True when the data came from a simulation; by default as the source of the laws states, unknown where laws of
        a stream have no source.
    data_file, data_sha256, n_rows, created, command, options, seed
        Provenance; only the versions of the programs are looked up. Of ``data_file``
        only the name is kept; ``created`` is an ISO date.
    **more
        Further sections, written as they are.

    Returns
    -------
    ParameterFile

    Raises
    ------
    GateError
        Convergence checks of a posterior failed; gains miss their specification.
    ParameterError
        Two laws of one response, laws of different data, no tool or work, or values that the schema refuses.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> runs = datasets.read_runs(datasets.bundled("gc435_709m40"))
    >>> pf = collect(laws=[fit.power_law(runs, "AW", ["V", "f", "d", "t"])])
    >>> pf.identity.tool, pf.identity.simulated, pf.provenance.n_rows
    ('GC435', True, 239)
    """
    source = _source(laws, tool, work, data_file is not None or data_sha256 is not None)
    simulated, note = (source.simulated, note or source.note or None) if simulated is None else (simulated, note)
    if data_file is None and data_sha256 is None:
        data_file, data_sha256 = source.file or None, source.sha256 or None
    identity = {
        "tool": source.tool, "work": source.work, "iso13399": dict(iso13399 or {}), "sensors": [*map(as_data, sensors)],
        "simulated": simulated, "note": note, "iso513": iso513, "setup": setup, "machine": machine or _machine(design),
    }  # fmt: skip
    found = laws_by_response(laws, source.tool, source.work, gauge_sd, _runs(design), posteriors)
    life = tool_life_section(tool_life, laws, found, _runs(design))
    bounds = None if limits is None else limits_section(limits)
    sections = {
        "design": None if design is None else design_section(design, found, criterion_of(life, bounds, options or {})),
        "dynamics": None if dynamics is None else dynamics_section(dynamics, held_out_fit), "roughness": roughness,
        "pi": None if pi is None else pi_section(pi, scaling_u=scaling_u, forced=pi_forced), "load_line": load_line,
        "tool_life": life, "limits": bounds, "adaptive_force": adaptive_force, "reading": reading_section(design),
    }  # fmt: skip
    base = {"identity": identity, "laws": found, "provenance": {
        "created": created, "command": command, "options": dict(options or {}), "seed": seed,
        **_origin(data_file, data_sha256, source.n_rows if n_rows is None else n_rows),
    }}  # fmt: skip
    pf = _gathered(base, sections, more, drawn=bool(posteriors or no_posterior))
    return completed(pf, posteriors, no_posterior, draws_kept=draws_kept) if complete else pf


def completed(
    pf: ParameterFile,
    posteriors: Sequence["Posterior"] = (),
    no_posterior: "Mapping[str, NotAvailable] | None" = None,
    *,
    draws_kept: bool = True,
) -> ParameterFile:
    """The file that `collect` began, with the section of these posteriors and its checksum; arguments as there.

    Raises
    ------
    GateError
        Convergence checks of a posterior failed.
    ParameterError
        Values that the schema refuses.

    Examples
    --------
    >>> from fitmodels import datasets, fit
    >>> law = fit.power_law(datasets.read_runs(datasets.bundled("gc435_709m40")), "AW", ["V", "f", "d", "t"])
    >>> started = collect(laws=[law], complete=False)
    >>> started.content_sha256, completed(started) == collect(laws=[law])
    (None, True)
    """
    section = _posterior(posteriors, no_posterior or {}, draws_kept)
    return sealed(pf if section is None else _validated({**dict(pf), "posterior": section}))


def _base_name(path: str | PurePath) -> str:
    """Name of a file without folders, whichever system its path is of."""
    return PureWindowsPath(PurePath(path).name).name


def _source(laws: "Sequence[LawFit]", tool: str | None, work: str | None, data_given: bool) -> "LawSource":
    """The source of the laws with tool and work as given; ParameterError where the laws have several."""
    from ..fit.fitted_rows import LawSource

    sources = [law.source for law in laws]
    if not laws and (tool is None or work is None):
        raise ParameterError("no laws to take tool and work from: give tool= and work=.")
    first = sources[0] if sources else LawSource(simulated=False)
    for law, other in zip(laws, sources, strict=True):
        one = (tool or first.tool, work or first.work, *(() if data_given else (first.file, first.sha256)))
        two = (tool or other.tool, work or other.work, *(() if data_given else (other.file, other.sha256)))
        if one != two:
            raise ParameterError(
                f"the laws of {laws[0].response} and {law.response} come from different data ({_named(first)}; "
                f"{_named(other)}): fit them to the same runs, or give tool, work, data_file and data_sha256."
            )
    return replace(first, tool=tool or first.tool, work=work or first.work)


def _named(source: "LawSource") -> str:
    checksum = f" (SHA-256 {source.sha256[:8]}...)" if source.sha256 else ""
    return f"{source.tool or 'no tool'} on {source.work or 'no work'}, {source.file or 'rows in memory'}{checksum}"


def _runs(design: object) -> "Runs | None":
    """The runs of a design, None where it is a section."""
    from ..datasets import Runs

    return design if isinstance(design, Runs) else None


def _machine(design: object) -> str | None:
    """The machine that the notes of a data file name."""
    from ..datasets.notes import machine_name

    runs = _runs(design)
    return None if runs is None else machine_name(runs.notes) or None


def _posterior(
    posteriors: Sequence["Posterior"], none: "Mapping[str, NotAvailable]", kept: bool
) -> dict[str, Any] | None:
    if not posteriors and not none:
        return None
    return posterior_section(posteriors, none) if kept else posterior_section(posteriors, none, None)


def _gathered(
    base: Mapping[str, object], given: Mapping[str, Any], more: Mapping[str, object], *, drawn: bool
) -> ParameterFile:
    """The file of these sections, to which `completed` adds that of the posteriors where they were ``drawn``."""
    sections = {**base, **{name: as_data(section) for name, section in given.items() if section is not None}}
    written = {"schema_version", "content_sha256", *sections} | ({"posterior"} if drawn else set())
    if taken := sorted(written & set(more)):
        raise ParameterError(f"{taken[0]} is written by collect itself; give its parts by name.")
    return _validated({**sections, **more})


def _validated(data: Mapping[str, object]) -> ParameterFile:
    try:
        return ParameterFile.model_validate(data)
    except ValidationError as error:
        raise ParameterError(f"cannot collect: {schema_message(error, data)}.") from None


def _origin(file: str | PurePath | None, sha256: str | None, n_rows: int | None) -> dict[str, object]:
    """Fields of the provenance on the data and on the programs."""
    versions = {"python": platform.python_version(), "numpy": np.__version__, "scipy": scipy.__version__}
    name = None if file is None else _base_name(file)
    return {
        "data_file": name,
        "data_sha256": sha256,
        "n_rows": n_rows,
        "fitmodels": __version__,
        "versions": versions,
    }
