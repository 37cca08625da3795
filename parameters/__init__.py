"""What is handed over: the parameter file, which predicts without the fitting rooms.

    errors           what this room raises, in sentences
    strict_json      JSON without anything two readers could read differently
    canonical        the form that the checksum is of
    migrate          versions of the schema
    json_schema      the schema as it is published
    file             the whole file: read and write
    draws            the draws beside the file
    sections/        one class a section: identity, design, laws, posterior, dynamics, gains, settings, limits ...

    evaluate         a law's numbers: terms, link, checks
    intervals        what an interval of a law stands on, and its ends
    prediction       a law's answer, in numbers and in a sentence
    rounding         numbers rounded by their uncertainty

    collect          results -> a parameter file; gather/ holds one kind of result a file
    setting_rules    a load law and wear tests -> settings of constant load
    feed_limits      feed at a load and a wear, with its interval
    check            whether a file may be handed to a controller; checks/ holds one kind of question a file
    export/          the file as a controller loads it

>>> from fitmodels import parameters
>>> pf = parameters.collect(tool="GC435", work="709M40", laws=[])
>>> pf.schema_version
'fitmodels.parameters/1'
"""

from .canonical import content_sha256
from .check import CheckReport, Finding, check
from .collect import collect
from .draws import Draws, read_draws
from .file import ParameterFile, read, sealed, write
from .gather.design import design_section
from .gather.dynamics import dynamics_section, pi_section
from .gather.posterior import draws_of
from .prediction import Given, Prediction
from .sections.adaptive_force import AdaptiveForce, SetPoint
from .sections.base import Section
from .sections.covariance import Covariance, ModelCovariance, NoCovariance
from .sections.design import Criterion, Design, DesignFactor, DesignLevel, EdgeFacts, LeftOutRows
from .sections.dynamics import Dynamics
from .sections.identity import Identity, Provenance, Sensor
from .sections.law import Law
from .sections.law_parts import (
    By,
    Check,
    DroppedRows,
    Edges,
    Factor,
    LeftOut,
    Published,
    Region,
    Statistics,
    ToolLifeSection,
)
from .sections.limits import Bound, Limits, Range
from .sections.load_line import Engagement, FeedLimit, LimitInterval, LoadLine, NoInterval
from .sections.pi import Pi, PiFigures, PiSpecification
from .sections.posterior import Drawn, LawPosterior, Posterior, Prior
from .sections.roughness import Roughness
from .setting_rules import settings

__all__ = [
    "AdaptiveForce",
    "Bound",
    "By",
    "Check",
    "CheckReport",
    "Covariance",
    "Criterion",
    "Design",
    "DesignFactor",
    "DesignLevel",
    "Drawn",
    "Draws",
    "DroppedRows",
    "Dynamics",
    "EdgeFacts",
    "Edges",
    "Engagement",
    "Factor",
    "FeedLimit",
    "Finding",
    "Given",
    "Identity",
    "Law",
    "LawPosterior",
    "LeftOut",
    "LeftOutRows",
    "LimitInterval",
    "Limits",
    "LoadLine",
    "ModelCovariance",
    "NoCovariance",
    "NoInterval",
    "ParameterFile",
    "Pi",
    "PiFigures",
    "PiSpecification",
    "Posterior",
    "Prediction",
    "Prior",
    "Provenance",
    "Published",
    "Range",
    "Region",
    "Roughness",
    "Section",
    "Sensor",
    "SetPoint",
    "Statistics",
    "ToolLifeSection",
    "check",
    "collect",
    "content_sha256",
    "design_section",
    "draws_of",
    "dynamics_section",
    "pi_section",
    "read",
    "read_draws",
    "sealed",
    "settings",
    "write",
]
