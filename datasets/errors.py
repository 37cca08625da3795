"""What the project raises: one sentence that names the thing, the value, the limit and the cure."""


class FitmodelsError(Exception):
    """Base of every error the project raises on purpose; its text is meant for the user.

    ``exit_code`` is what the command ends with when it meets one.
    """

    exit_code = 1


class UsageError(FitmodelsError):
    """What was asked for cannot be asked: an option, a column or a name that does not exist."""

    exit_code = 2


class DataError(FitmodelsError):
    """The data cannot be read or used."""

    exit_code = 3
