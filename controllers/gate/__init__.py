"""The gate in front of the export of a running control: only what it passes can be written for a machine.

>>> from fitmodels.controllers.gate import GatedControl
>>> try:
...     GatedControl()
... except TypeError as error:
...     print(error)
a GatedControl is made by gated_control(pf), which checks the control first
"""

from typing import TYPE_CHECKING, final

from ...core.errors import GateError
from ...parameters.exports.loop import LoadLoop, loop_settings
from ...parameters.exports.view import ExportView, export_view

if TYPE_CHECKING:
    from ...parameters import ParameterFile

_MADE_BY_THE_GATE = object()


@final
class GatedControl:
    """A control that has passed the gate, the only argument that the writers of running controls take.

    Attributes
    ----------
    view : ExportView
        The parameter file as a controller needs it.
    loop : LoadLoop
        Gains, limits and settings of the control, in the form of the file: ``position`` or ``incremental_sum``.
    """

    __slots__ = ("loop", "view")
    view: ExportView
    loop: LoadLoop

    def __init__(self, view: ExportView | None = None, loop: LoadLoop | None = None, *, _key: object = None) -> None:
        if _key is not _MADE_BY_THE_GATE or view is None or loop is None:
            raise TypeError("a GatedControl is made by gated_control(pf), which checks the control first")
        object.__setattr__(self, "view", view)
        object.__setattr__(self, "loop", loop)

    def __setattr__(self, name: str, value: object) -> None:
        """Refuse: what passed the gate does not change."""
        raise AttributeError(f"GatedControl.{name} cannot be set")


def gated_control(pf: "ParameterFile", *, accept_verdict: bool = False) -> GatedControl:
    """The control of a parameter file, once it has passed the gate.

    Parameters
    ----------
    pf : ParameterFile
    accept_verdict : bool
        Accept laws and dynamics that must not be used for control, or have no verdict.

    Raises
    ------
    GateError
        The file fails the check, has no control, or a part of it must not be used for control.
    """
    view = export_view(pf, accept_verdict=accept_verdict, loop_only=True)
    found = loop_settings(pf, own_form=True)
    if found.loop is None:
        raise GateError(f"the parameter file of {view.tool} on {view.work} {found.lacking}")
    return GatedControl(view, found.loop, _key=_MADE_BY_THE_GATE)
