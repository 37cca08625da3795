"""What this room raises."""

from ..datasets.errors import FitmodelsError


class IdentError(FitmodelsError):
    """A model cannot be identified from this record, or gains cannot be found; the sentence says why and what to do."""

    exit_code = 4
