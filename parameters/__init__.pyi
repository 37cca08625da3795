from .checks import check as check
from .collection import collect as collect
from .draws import read_draws as read_draws
from .exports import export as export
from .file import ParameterFile as ParameterFile
from .file import read as read
from .file import write as write
from .gather.posterior import draws_of as draws_of
from .sections.law import LawSection as LawSection
from .setting_rules import settings as settings

__all__ = [
    "LawSection",
    "ParameterFile",
    "check",
    "collect",
    "draws_of",
    "export",
    "read",
    "read_draws",
    "settings",
    "write",
]
