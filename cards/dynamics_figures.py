"""The figures of an identification: simulated over measured, Bode, residuals, orders."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ..ident.identification import Identification

DYNAMICS_FIGURES = ("figures/simulated.png", "figures/bode.png", "figures/residuals.png", "figures/orders.png")


def draw_dynamics(found: "Identification", folder: Path, caption: str = "") -> None:
    """Write them into ``folder``; ``caption`` is told on each."""
    from ..ident import frequency_response
    from ..ident.draw import bode, order_map, residual_correlations, simulated_fit

    folder.mkdir(parents=True, exist_ok=True)
    axes = {
        "simulated": simulated_fit(found.validation),
        "bode": bode(found.model, frequency_response(found.record))[0],
        "residuals": residual_correlations(found.validation)[0],
        "orders": order_map(found.one_step),
    }
    for name, ax in axes.items():
        figure = ax.get_figure()
        if figure is None:
            continue
        if caption:
            figure.text(0.99, 0.005, caption, ha="right", va="bottom", fontsize=7, color="0.4")
        figure.savefig(folder / f"{name}.png", dpi=110)  # type: ignore[union-attr]
