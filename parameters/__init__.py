"""What is handed over: the parameter file, which predicts without the fitting rooms.

    errors           what this room raises, in sentences
    base             what every section is made of
    strict_json      JSON without anything two readers could read differently
    canonical        the form that the checksum is of
    migrate          versions of the schema
    json_schema      the schema as it is published
    file             the whole file: read and write

    identity         tool, work, machine, sensors; where the numbers come from
    sections         the small parts of a law section
    covariance       what an estimate is uncertain by
    law              the law section and its predict, interval, tell, inside
    evaluate         a law's numbers: terms, link, checks
    intervals        what an interval of a law stands on, and its ends
    rounding         numbers rounded by their uncertainty
    prediction       a law's answer, in numbers and in a sentence
    posterior        the posterior section
    draws            the draws beside the file
    dynamics         an identified model, which simulates
    pi               gains, and what they were tuned to
    load_line        settings of milling at constant load
    limits           what machine, tool and work allow
    roughness        settings of turning at constant roughness
    adaptive_force   settings of adaptive force control

    collect          results -> a parameter file (gather_*: one kind of result each)
    check            whether a file may be handed to a controller (check_*: one kind of question each)
    loop_figures     what gains do on the dynamics, from the file alone
    setting_rules    a load law and wear tests -> settings of constant load
    feed_limits      feed at a load and a wear, with its interval

>>> from fitmodels import parameters
>>> pf = parameters.collect(tool="GC435", work="709M40", laws=[])
>>> pf.schema_version
'fitmodels.parameters/1'
"""

from .adaptive_force import AdaptiveForce, SetPoint
from .base import Section
from .canonical import content_sha256
from .check import CheckReport, Finding, check
from .collect import collect
from .covariance import Covariance, ModelCovariance, NoCovariance
from .draws import Draws, read_draws
from .dynamics import Dynamics
from .errors import GateError, ParameterError
from .file import ParameterFile, read, sealed, write
from .gather_dynamics import dynamics_section, pi_section
from .identity import Identity, Provenance, Sensor
from .law import Law
from .limits import Bound, Limits, Range
from .load_line import Engagement, FeedLimit, LimitInterval, LoadLine, NoInterval
from .pi import Pi, PiFigures, PiSpecification
from .posterior import Drawn, LawPosterior, Posterior, Prior
from .posterior_section import draws_of
from .prediction import Given, Prediction
from .roughness import Roughness
from .sections import (
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
from .setting_rules import settings

__all__ = [
    "AdaptiveForce",
    "Bound",
    "By",
    "Check",
    "CheckReport",
    "Covariance",
    "Drawn",
    "Draws",
    "DroppedRows",
    "Dynamics",
    "Edges",
    "Engagement",
    "Factor",
    "FeedLimit",
    "Finding",
    "GateError",
    "Given",
    "Identity",
    "Law",
    "LawPosterior",
    "LeftOut",
    "LimitInterval",
    "Limits",
    "LoadLine",
    "ModelCovariance",
    "NoCovariance",
    "NoInterval",
    "ParameterError",
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
    "draws_of",
    "dynamics_section",
    "pi_section",
    "read",
    "read_draws",
    "sealed",
    "settings",
    "write",
]
