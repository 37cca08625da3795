"""Settings and loop of a file as the controller runs it: in the file's own form, past the gate of an export."""

from typing import TYPE_CHECKING

from ...core.errors import GateError, ParameterError

if TYPE_CHECKING:
    from ...parameters import LoadLineSection, ParameterFile
    from ...parameters.export.loop import LoadLoop


def line_of(pf: "ParameterFile") -> "LoadLineSection":
    """Settings of milling at constant load.

    Raises
    ------
    ParameterError
        The file has none.
    """
    if pf.load_line is None:
        raise ParameterError(
            "the file has no settings of milling at constant load; set them with `fitmodels settings params.json`."
        )
    return pf.load_line


def loop_of(pf: "ParameterFile") -> "LoadLoop":
    """Gains, limits and settings.

    Raises
    ------
    GateError
        The file has no gains or no settings of the loop, or fails the check.
    """
    from ...parameters.export.gate import passed
    from ...parameters.export.names import plain
    from ...parameters.export.settings import settings

    passed(pf)
    found = settings(pf, own_form=True)
    if found.loop is None:
        raise GateError(f"the parameter file of {plain(pf.identity.tool)} on {plain(pf.identity.work)} {found.lacking}")
    return found.loop
