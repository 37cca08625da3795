"""What a step fit says in words."""

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from .step_response import StepFit

POOR = 80.0  # % fit below which the form, not the noise, is the trouble


def verdict(fit: "StepFit", over: float) -> str:
    """Numbers with their errors, then what speaks against them; ``over`` is the measured overshoot."""
    units = _units(fit)
    told = [
        f"{name.replace('_', ' ')} {value:.4g} +- {error:.2g}{units[name]}"
        for name, value, error in zip(fit.names, fit.params.to_numpy(), fit.bse.to_numpy(), strict=True)
    ]
    kind = "white" if not fit.colour else f"coloured (autoregression of order {fit.colour}), which the errors allow for"
    text = f"{', '.join(told)}; 63.2 % after {fit.time_to_63:.4g} s; fit {fit.fit:.1f} %; residuals {kind}."
    return " ".join([text, *_against(fit, over)])


def _units(fit: "StepFit") -> dict[str, str]:
    gain = f" {fit.unit_y or '1'}/{fit.unit_u or '1'}" if fit.unit_y or fit.unit_u else ""
    return {"gain": gain, "time_constant": " s", "natural_frequency": " rad/s", "damping": "", "delay": " s"}


def _against(fit: "StepFit", over: float) -> list[str]:
    out = []
    if fit.rate_limit is not None:
        unit = f"{fit.unit_y}/s" if fit.unit_y else "1/s"
        out.append(
            f"The output rises in straight lines of {fit.rate_limit:.4g} {unit}: a rate limit, not a lag. Its time "
            "grows with the size of the step; step by less to see the lag."
        )
    if fit.order == 1 and over > max(0.05, 4 * fit.scatter):
        out.append(f"The output overshoots by {100 * over:.0f} %: fit order 2.")
    if fit.order == 2 and len(fit.time_constants) == 2:
        slow, fast = fit.time_constants
        out.append(f"Overdamped: time constants {slow:.4g} and {fast:.4g} s.")
    if fit.order == 2:
        damping, error = fit.shape[1], float(fit.bse["damping"])
        if error > damping / 2:
            out.append("The second order is not told apart from a delay: fit order 1.")
        elif error > 1e-6 and abs(damping - 1) < 2 * error:
            out.append("Damping 1 lies within two standard errors: whether it swings is open.")
    window = max(float(np.max(np.diff([*run.at, run.time[-1]]))) for run in fit.runs)
    if fit.time_to_63 - fit.delay > (window - fit.delay) / 3:
        out.append(f"The step has not settled within {window:.3g} s: gain and time are extrapolated. Record longer.")
    if "delay" not in fit.names and fit.delay < 1e-6 * window:
        out.append("No delay shows.")
    if fit.fit < POOR and fit.rate_limit is None:
        out.append(f"Order {fit.order} describes it poorly: look at the figure, and try order {3 - fit.order}.")
    return out
