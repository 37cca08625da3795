"""Checks of a parameter file before a controller loads it: one finding, one sentence, for each test.

report   findings; verdicts of laws, dynamics and force process, and the refusal to export what must not be used
values   units, covariances, posterior, dynamics and settings; gains, loop_figures: the gains on the dynamics
record   laws against their equations, posteriors and regions; the record of the dynamics against the load tests: range,
         slope, scaling; the limits against the tests
"""

import os
from collections.abc import Iterator
from shlex import quote
from typing import TYPE_CHECKING

from ...core.errors import ParameterError
from ..data_sources import corrections
from ..draws import read_draws
from ..file import seal_fault
from .gains import check_gains
from .record import check_limits, check_texts, record_notes
from .report import CheckReport, FileFinding, check_verdicts
from .values import check_estimates, check_settings, check_units

if TYPE_CHECKING:
    from ..file import ParameterFile


def check(pf: "ParameterFile", folder: str | os.PathLike[str] | None = None) -> CheckReport:
    """Check a parameter file before a controller loads it.

    Checksum; simulated data; laws against the text of their equations, their posteriors and their tested regions;
    verdicts of laws, dynamics and force process; doubts about the data; units known and of the right dimension;
    covariances; convergence of the posterior; dynamics stable, with a gain of known sign; gains stable on them and
    within their specification, recomputed from the file; feed limits in order and above zero; windows and settings in
    order; limits possible and near the tests; the file of draws.

    Parameters
    ----------
    pf : ParameterFile
    folder : path, optional
        Folder of the file; without it the draws are not checked. A file that has a folder, or was read from disk, must
        have a checksum.

    Returns
    -------
    CheckReport

    Examples
    --------
    >>> from fitmodels import parameters
    >>> report = check(parameters.collect(tool="GC435", work="709M40", limits={"power": 7.0}))
    >>> report.ok, [finding.name for finding in report.findings]
    (True, ['checksum', 'units'])
    """
    found = [
        _checksum(pf, on_disk=pf.is_read or folder is not None),
        *check_texts(pf),
        *_origin(pf),
        *check_verdicts(pf),
        *_reading(pf),
        *check_units(pf),
        *check_estimates(pf),
        *_draws(pf, folder),
        *(FileFinding("record", None, words) for words in record_notes(pf)),
        *check_gains(pf),
        *check_settings(pf),
        *check_limits(pf),
    ]
    return CheckReport(tuple(found))


def _checksum(pf: "ParameterFile", *, on_disk: bool) -> FileFinding:
    """Whether the content is that which was written; a file on disk without a checksum may hide a change."""
    fault = seal_fault(pf)
    if not fault:
        return FileFinding("checksum", True, "The content is unchanged.")
    if pf.content_sha256 is None and not on_disk:
        return FileFinding("checksum", None, "The file has no content_sha256, so a change cannot be detected.")
    words = f"{fault[:1].upper()}{fault[1:]}: restore the file, or make the change with fitmodels, which writes it."
    return FileFinding("checksum", False, words.replace("It has", "The file has").replace("Its content", "The content"))


def _origin(pf: "ParameterFile") -> Iterator[FileFinding]:
    """Whether the data were simulated, which does not fail the file."""
    if pf.identity.simulated:
        words = "The data are simulated or computed, not measured: do not run a machine with this file."
        yield FileFinding("simulated", None, words)


def _reading(pf: "ParameterFile") -> Iterator[FileFinding]:
    """Doubts about the data file behind the laws, which do not fail the file."""
    of = pf.provenance.data_file
    if pf.reading is None:
        if pf.laws and of is not None:
            words = f"It is not known whether {of} was read without doubts; read it with `fitmodels look {quote(of)}`."
            yield FileFinding("reading", None, words)
        return
    for doubt in pf.reading.doubts:
        remedy = f" Remedy: fitmodels {of or 'FILE'} {doubt.remedy}" if doubt.remedy else ""
        yield FileFinding("doubt", None, f"{doubt.sentence.rstrip('.')}.{remedy}")
    if not pf.reading.doubts:
        yield FileFinding("reading", True, _undoubted(pf, of or "the data"))


def _undoubted(pf: "ParameterFile", data: str) -> str:
    """Sentence on a reading without doubts, with the corrections that it was made with."""
    options = (("corrected", corrections(pf, "correct")), ("left out", corrections(pf, "leave_out")))
    changed = "; ".join(f"{name}: {', '.join(given)}" for name, given in options if given)
    if not changed:
        return f"The reading of {data} raised no doubt."
    return f"No doubt is left about the reading of {data}; {changed}."


def _draws(pf: "ParameterFile", folder: str | os.PathLike[str] | None) -> Iterator[FileFinding]:
    post = pf.posterior
    if post is None or post.draws_file is None:
        return
    if folder is None:
        yield FileFinding("draws", None, f"The draws in {post.draws_file} were not checked: no folder was given.")
        return
    try:
        read = read_draws(pf, folder)
    except ParameterError as error:
        yield FileFinding("draws", False, str(error))
        return
    odd = [name for name, law in post.laws.items() if law.method is not None and name not in read]
    counted = [n for n, law in post.laws.items() if n in read and law.draws not in (None, len(read[n].values))]
    wrong = odd or counted
    problem = f"lacks draws of {wrong[0]}, or has another number of them; fit again" if wrong else "is unchanged"
    yield FileFinding("draws", not wrong, f"{post.draws_file} {problem}.")
