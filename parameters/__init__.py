"""What is handed over: the parameter file, which predicts without the fitting rooms.

    errors       what this room raises, in sentences
    sections     the small parts of a law section
    evaluate     a law's numbers: terms, link, checks
    intervals    what an interval of a law stands on, and its ends
    rounding     numbers rounded by their uncertainty
    prediction   a law's answer, in numbers and in a sentence
    law          the law section and its predict, interval, tell, inside
    strict_json  JSON without anything two readers could read differently
    file         the schema, read and write
    posterior    the posterior section
    draws        the draws beside the file
    collect      fitted laws -> a parameter file

>>> from fitmodels import parameters
>>> pf = parameters.collect(tool="GC435", work="709M40", laws=[])
>>> pf.schema_version
'fitmodels.parameters/1'
"""

from .collect import collect
from .draws import Draws, read_draws
from .errors import GateError, ParameterError
from .file import Identity, ParameterFile, Provenance, read, write
from .law import Law
from .posterior import Drawn, LawPosterior, Posterior, Prior
from .posterior_section import draws_of
from .prediction import Given, Prediction
from .sections import (
    By,
    Check,
    Covariance,
    DroppedRows,
    Edges,
    Factor,
    LeftOut,
    NoCovariance,
    Published,
    Region,
    Section,
    Statistics,
    ToolLifeSection,
)

__all__ = [
    "By",
    "Check",
    "Covariance",
    "Drawn",
    "Draws",
    "DroppedRows",
    "Edges",
    "Factor",
    "GateError",
    "Given",
    "Identity",
    "Law",
    "LawPosterior",
    "LeftOut",
    "NoCovariance",
    "ParameterError",
    "ParameterFile",
    "Posterior",
    "Prediction",
    "Prior",
    "Provenance",
    "Published",
    "Region",
    "Section",
    "Statistics",
    "ToolLifeSection",
    "collect",
    "draws_of",
    "read",
    "read_draws",
    "write",
]
