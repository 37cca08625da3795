"""First lines of the head of an exported control: no safety function, what a fault does, and the limits of the feed."""

from ...parameters.exports.loop import LoadLoop
from ...parameters.exports.view import NO_SAFETY, ExportView

SAFETY = tuple(f"{words[0].upper()}{words[1:]}." for words in NO_SAFETY)


def first_lines(view: ExportView, loop: LoadLoop, *of_limits: str) -> tuple[str, ...]:
    """Lines below the title of every exported control; ``of_limits`` are further ones on the limits."""
    return (*SAFETY, _fault(loop), _limits(loop), *of_limits, *([view.tool_change] if view.tool_change else []))


def _fault(loop: LoadLoop) -> str:
    """What a fault does, and of constant load the choice."""
    if loop.stop_on_fault:
        return "On a fault the feed stops: --on-fault stop was chosen."
    choice = "; to stop: fitmodels settings --on-fault stop" if loop.law == "pi" else ""
    return f"On a fault the feed falls to its lower limit and the cut goes on{choice}."


def _limits(loop: LoadLoop) -> str:
    """Reference and feed limits in the units of the machine, and as shares of the programmed feed."""
    return (
        f"Load {loop.reference:.6g} {loop.unit_load}; feed {loop.feed_low:.4g} to {loop.feed_high:.4g} "
        f"{loop.unit_feed}, {loop.low:.4g} to {loop.high:.4g} of the programmed {loop.feed_programmed:.6g} "
        f"{loop.unit_feed}."
    )
