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
from .check import CheckReport, FileFinding, check
from .collect import collect
from .draws import Draws, read_draws
from .file import ParameterFile, read, sealed, write
from .gather.design import design_section
from .gather.dynamics import dynamics_section, pi_section
from .gather.posterior import draws_of
from .prediction import GivenFactor, Prediction
from .sections.adaptive_force import AdaptiveForceSection, SetPoint
from .sections.base import Section
from .sections.covariance import Covariance, ModelCovariance, NoCovariance
from .sections.design import Criterion, DesignFactor, DesignLevel, DesignSection, EdgeFacts, LeftOutRows
from .sections.dynamics import DynamicsSection
from .sections.identity import IdentitySection, ProvenanceSection, Sensor
from .sections.law import LawSection
from .sections.law_parts import (
    DroppedRows,
    Edges,
    Factor,
    LawCheck,
    LeftOutFactor,
    LevelShifts,
    Published,
    Region,
    Statistics,
    ToolLifeSection,
)
from .sections.limits import Bound, LimitsSection, Range
from .sections.load_line import Engagement, FeedLimit, LimitInterval, LoadLineSection, NoInterval
from .sections.pi import PiFigures, PiSection, PiSpecification
from .sections.posterior import LawPosterior, PosteriorSection, PosteriorSummary, Prior
from .sections.roughness import RoughnessSection
from .setting_rules import settings

__all__ = [
    "AdaptiveForceSection",
    "Bound",
    "CheckReport",
    "Covariance",
    "Criterion",
    "DesignFactor",
    "DesignLevel",
    "DesignSection",
    "Draws",
    "DroppedRows",
    "DynamicsSection",
    "EdgeFacts",
    "Edges",
    "Engagement",
    "Factor",
    "FeedLimit",
    "FileFinding",
    "GivenFactor",
    "IdentitySection",
    "LawCheck",
    "LawPosterior",
    "LawSection",
    "LeftOutFactor",
    "LeftOutRows",
    "LevelShifts",
    "LimitInterval",
    "LimitsSection",
    "LoadLineSection",
    "ModelCovariance",
    "NoCovariance",
    "NoInterval",
    "ParameterFile",
    "PiFigures",
    "PiSection",
    "PiSpecification",
    "PosteriorSection",
    "PosteriorSummary",
    "Prediction",
    "Prior",
    "ProvenanceSection",
    "Published",
    "Range",
    "Region",
    "RoughnessSection",
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
