"""Whether a parameter file may be handed to a controller: every question asked, every answer one sentence."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..core.display import Displayable
from ..core.errors import ParameterError
from .canonical import content_sha256
from .checks.estimates import estimates
from .checks.finding import FileFinding
from .checks.loop import loop
from .checks.settings import settings_in_order
from .checks.units import units
from .draws import read_draws

if TYPE_CHECKING:
    from pandas import DataFrame

    from .file import ParameterFile

__all__ = ["CheckReport", "FileFinding", "check"]


@dataclass(frozen=True, slots=True, repr=False)
class CheckReport(Displayable):
    """All findings on a file.

    Attributes
    ----------
    findings : tuple of FileFinding
        In the order they were asked.
    """

    findings: tuple[FileFinding, ...]

    @property
    def failed(self) -> tuple[FileFinding, ...]:
        """Findings that stand against the file."""
        return tuple(f for f in self.findings if f.passed is False)

    @property
    def ok(self) -> bool:
        """Whether nothing stands against the file; what could not be asked does not."""
        return not self.failed

    def facts(self) -> dict[str, Any]:
        """The report for programs, without a name of its schema."""
        return {
            "ok": self.ok,
            "findings": [{"name": f.name, "passed": f.passed, "words": f.words} for f in self.findings],
        }

    def to_frame(self) -> "DataFrame":
        """A row a finding."""
        from pandas import DataFrame

        return DataFrame([(f.name, f.passed, f.words) for f in self.findings], columns=["name", "passed", "words"])


def check(pf: "ParameterFile", folder: str | os.PathLike[str] | None = None) -> CheckReport:
    """Check a parameter file before a controller gets it.

    Checksum; units known and of the right kind; covariances; the posterior's gate; dynamics stable, with a gain that
    has a sign; gains stable on them and meeting what they were tuned to, computed again from the file alone; feed
    limits in order and above zero; windows and settings in order; the draws beside the file.

    Parameters
    ----------
    pf : ParameterFile
    folder : path, optional
        Where the file stands; without it the draws beside it are not looked at.

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
    found = [_checksum(pf), *units(pf), *estimates(pf), *_draws(pf, folder), *loop(pf), *settings_in_order(pf)]
    return CheckReport(tuple(found))


def _checksum(pf: "ParameterFile") -> FileFinding:
    if pf.content_sha256 is None:
        return FileFinding(
            "checksum", None, "The file holds no content_sha256, so nobody can tell whether it was changed."
        )
    found = content_sha256(pf.model_dump(exclude_unset=True))
    if found == pf.content_sha256:
        return FileFinding("checksum", True, "The content is what was written.")
    return FileFinding(
        "checksum",
        False,
        f"The content was changed after it was written (SHA-256 {found[:12]}..., not {pf.content_sha256[:12]}...): "
        "restore the file, or make the change with fitmodels, which renews the checksum.",
    )


def _draws(pf: "ParameterFile", folder: str | os.PathLike[str] | None) -> Iterator[FileFinding]:
    post = pf.posterior
    if post is None or post.draws_file is None:
        return
    if folder is None:
        yield FileFinding("draws", None, f"The draws in {post.draws_file} were not looked at: no folder was given.")
        return
    try:
        read = read_draws(pf, folder)
    except ParameterError as error:
        yield FileFinding("draws", False, str(error))
        return
    odd = [name for name, law in post.laws.items() if law.method is not None and name not in read]
    counted = [n for n, law in post.laws.items() if n in read and law.draws not in (None, len(read[n].values))]
    wrong = odd or counted
    words = f"{post.draws_file} holds no or other draws of {wrong[0]}; fit again." if wrong else (
        f"{post.draws_file} is the file of draws that was written."
    )  # fmt: skip
    yield FileFinding("draws", not wrong, words)
