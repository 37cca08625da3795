"""What a card's numbers are for, what they are not for, and what a person checks before a machine moves."""

from ...parameters import ParameterFile


def intended(pf: ParameterFile) -> tuple[str, ...]:
    """Uses that the file has the sections for."""
    pair, said = f"{pf.identity.tool} on {pf.identity.work}", []
    if pf.laws:
        said.append(
            f"To choose conditions and to predict {', '.join(pf.laws)} for {pair}, inside the ranges of the tests, "
            "with the interval beside every prediction."
        )
    if pf.tool_life:
        said.append(
            f"To plan tool changes at {pf.tool_life.wear} {pf.tool_life.criterion:g} {pf.tool_life.unit_of_wear}."
        )
    if pf.dynamics:
        said.append(f"To simulate {pf.dynamics.output} from {pf.dynamics.input} and to tune a controller for it.")
    if pf.pi:
        said.append(
            "To set up a PI controller with the form, sample time and limits given here, after the checks below."
        )
    if pf.load_line:
        said.append("To mill at constant load with the reference and the feed limits given here.")
    if pf.roughness:
        said.append("To turn at constant roughness through the reference force given here.")
    if pf.adaptive_force:
        said.append("To start an adaptive force controller from the estimates and rates given here.")
    return tuple(said) or (f"As a record of {pair}: the file holds nothing to compute with yet.",)


def out_of_scope(pf: ParameterFile) -> tuple[str, ...]:
    """Uses that the numbers do not bear."""
    said = ["Other tools, other work, another machine or set-up: nothing was tested there."]
    if pf.laws:
        said.append(
            "Conditions outside the ranges and outside the tested region: a law says nothing about where nobody cut."
        )
        said.append(
            "Sudden failure (chipping, breakage) and built-up edge: the laws tell gradual change, and its scatter."
        )
    if pf.dynamics:
        band = pf.dynamics.band
        where = f" ({band[0]:.3g} to {band[1]:.3g} Hz)" if band else ""
        said.append(
            f"Dynamics outside the excited band{where}, or far from the operating point they were identified at."
        )
    if pf.identity.simulated:
        said.append("Any machine at all as it stands: the numbers come from a simulation, for trying methods out.")
    said.append("Computing from the rounded numbers of this card: take the equations or params.json for that.")
    return tuple(said)


def safety(pf: ParameterFile) -> tuple[str, ...]:
    """A plain warning, and what has to be looked at by a person first."""
    said = []
    if pf.identity.simulated:
        said.append("NOT MEASURED: these numbers come from a simulation. Do not run a machine by them.")
    said.append(
        "These numbers are estimates from a limited number of tests; about one in twenty cuts may lie outside a 95 % "
        "interval even where everything is as it was in the tests. They are no safety function and replace no guard."
    )
    said.append(
        "Before a machine moves, a person who knows it checks: the hard limits of spindle power, torque, force, feed "
        "and speed in the control itself; clamping and overhang; that tool, work and units are those of this card; "
        "that the emergency stop works."
    )
    if _acts(pf):
        said += _of_a_loop(pf)
    else:
        said.append(
            "Approach new conditions from the safe side, in steps, and stop where load or sound are not as expected."
        )
    return tuple(said)


def _acts(pf: ParameterFile) -> bool:
    return any((pf.pi, pf.load_line, pf.roughness, pf.adaptive_force))


def _of_a_loop(pf: ParameterFile) -> list[str]:
    said = [
        "A controller with these settings changes the feed by itself. First run it in the air, then with low limits of "
        "feed and of its rate, a hand on the stop; the limits must hold in the control, not only in the file.",
        "Check what the loop does when the sensor fails, saturates or reads zero, and when the tool enters and leaves "
        "the work: it must come to a safe feed by itself.",
    ]
    pi = pf.pi
    if pi is not None and pi.forced:
        said.insert(
            0, f"FORCED GAINS: they miss their specification ({pi.forced}). Do not close the loop without a new check."
        )
    if pi is not None and (pi.low is None or pi.high is None):
        said.append(
            "The file names no limits of the command on both sides: set them in the control before the loop is closed."
        )
    if pi is not None and pf.dynamics is None:
        said.append(
            "The file holds no dynamics, so these gains could not be checked on any: try them at a tenth first."
        )
    return said
