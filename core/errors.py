"""Exceptions of the project; each message states the object, the value, the limit and the remedy."""


class FitmodelsError(Exception):
    """Base of every error the project raises on purpose; its text is meant for the user.

    ``exit_code`` is what the command ends with when it meets one.
    """

    exit_code = 1


class UsageError(FitmodelsError):
    """An option, a column or a name does not exist, or takes another value."""

    exit_code = 2


class DataError(FitmodelsError):
    """The data cannot be read or used."""

    exit_code = 3


class RecordError(DataError):
    """A file of tests is expected, and the file is a record of one run, to be identified."""


class FitError(FitmodelsError):
    """A law cannot be fitted to these data."""

    exit_code = 4


class IdentError(FitmodelsError):
    """A model cannot be identified from this record, or no gains exist."""

    exit_code = 4


class ParameterError(FitmodelsError):
    """A parameter file cannot be read, written or used.

    Examples
    --------
    >>> from fitmodels.core.errors import ParameterError
    >>> from fitmodels.parameters import read
    >>> try:
    ...     read("nowhere.json")
    ... except ParameterError as error:
    ...     print(error)
    nowhere.json: the file does not exist; give the path of a params.json written by fitmodels.
    """

    exit_code = 3


class GateError(ParameterError):
    """A quality gate refuses to write; the message says what to do first."""

    exit_code = 5


class ReadingWarning(UserWarning):
    """Warning on tests that a call has read: what was assumed, and what is doubtful."""
