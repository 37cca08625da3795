"""What is handed over: the parameter file, which predicts without the fitting rooms.

    errors       what this room raises, in sentences
    sections     the small parts of a law section
    evaluate     a law's numbers: terms, link, checks
    law          the law section and its predict, interval, inside
    strict_json  JSON without anything two readers could read differently
    file         the schema, read and write
    collect      fitted laws -> a parameter file

>>> from fitmodels import parameters
>>> pf = parameters.collect(tool="GC435", work="709M40", laws=[])
>>> pf.schema_version
'fitmodels.parameters/1'
"""

from .collect import collect
from .errors import ParameterError
from .file import Identity, ParameterFile, Provenance, read, write
from .law import Law
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
    "DroppedRows",
    "Edges",
    "Factor",
    "Identity",
    "Law",
    "LeftOut",
    "NoCovariance",
    "ParameterError",
    "ParameterFile",
    "Provenance",
    "Published",
    "Region",
    "Section",
    "Statistics",
    "ToolLifeSection",
    "collect",
    "read",
    "write",
]
