"""A law of a stream of rows becomes a law section, but for what only rows can tell: that stays empty and is said."""

from typing import TYPE_CHECKING, Any

from pydantic import ValidationError

from ...core.errors import ParameterError
from ..messages import schema_message
from ..sections.law import LawSection
from .moments import edge_moments, moments

if TYPE_CHECKING:
    from ...fit import StreamedLaw


def streamed_section(law: "StreamedLaw") -> LawSection:
    """Turn a law of a stream into its section of the file.

    The region is the range of each factor; checks, smearing, the published law beside it and the fit with additive
    errors need rows, and the notes of the section say so.

    Raises
    ------
    ParameterError
        The fit holds what the schema refuses.

    Examples
    --------
    >>> from fitmodels import datasets
    >>> from fitmodels.fit.streamed.one_pass import streamed_power_law
    >>> table = datasets.read_runs(datasets.bundled("gc435_709m40")).data
    >>> section = streamed_section(streamed_power_law([table[:60], table[60:]], "AW", ["V", "f", "d", "t"]))
    >>> round(float(section.predict(V=100.0, f=0.2, d=2.0, t=10.0)), 3), section.n_edges, section.region is None
    (0.169, 24, True)
    """
    data = _section(law)
    try:
        return LawSection.model_validate(data)
    except ValidationError as error:
        raise ParameterError(
            f"the law of {law.response} cannot be handed over: {schema_message(error, data)}."
        ) from None


def _section(law: "StreamedLaw") -> dict[str, Any]:
    section = moments(law)
    return section | {"edges": _edges(law), "notes": [*section["notes"], *_not_available(law)]}


def _not_available(law: "StreamedLaw") -> list[str]:
    reasons = {"checks": law.checks, "region": law.region, "smearing": law.smearing, "additive errors": law.alternative}
    return [f"{name} not available: {reason}" for name, reason in reasons.items()]


def _edges(law: "StreamedLaw") -> dict[str, Any]:
    told = edge_moments(law, law.edges)
    if not law.edges:
        return told
    return told | {"rows_per_edge": law.rows_per_edge, "df_between": law.df_between, "df_within": law.df_within}
