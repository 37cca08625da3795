"""What may not be handed to a controller: a file that fails the check."""

from typing import TYPE_CHECKING

from ...core.errors import GateError
from ..check import check

if TYPE_CHECKING:
    from ..file import ParameterFile


def passed(pf: "ParameterFile") -> tuple[str, ...]:
    """Let a file pass that may be handed on, and tell what could not be asked of its gains.

    Raises
    ------
    GateError
        The check finds what must not reach a machine.

    Examples
    --------
    >>> from fitmodels import parameters
    >>> passed(parameters.collect(tool="GC435", work="709M40", laws=[]))
    ()
    """
    report = check(pf)
    if not report.ok:
        first, *others = report.failed
        more = f" {len(others)} more: `fitmodels check` tells them." if others else ""
        raise GateError(f"not exported, the file fails the check: {first.words}{more}")
    if pf.pi is None:
        return ()
    untried = pf.dynamics is None
    forced = pf.pi.forced is not None
    return (
        *(("the gains are right: the file holds no dynamics to try them on",) if untried else ()),
        *(("the gains will do although they miss their specification: they are marked as forced",) if forced else ()),
    )
