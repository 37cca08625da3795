"""What the room ``fit`` raises."""

from ..datasets.errors import FitmodelsError


class FitError(FitmodelsError):
    """A law cannot be fitted to these data; the sentence says why and what would help."""

    exit_code = 4
