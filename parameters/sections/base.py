"""What every part of the file is made of: `Section`, and the kinds of number and text it holds."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from ...core.display import Displayable

# strict: a number in quotes, or true for 1, is a mistake of whoever wrote the file
Number = Annotated[float, Field(strict=True)]
NotNegative = Annotated[float, Field(strict=True, ge=0)]
Positive = Annotated[float, Field(strict=True, gt=0)]
Share = Annotated[float, Field(strict=True, ge=0, le=1)]
Count = Annotated[int, Field(strict=True, ge=0, lt=2**63)]
Text = Annotated[str, Field(min_length=1)]
Name = Annotated[str, Field(min_length=1, max_length=500)]
Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]


class Section(Displayable, BaseModel):
    """A part of the file: frozen, without NaN or infinity, and keeping the fields it does not know.

    Examples
    --------
    >>> class Limits(Section):
    ...     feed: Number
    >>> Limits(feed=0.4, later="kept").model_dump()
    {'feed': 0.4, 'later': 'kept'}
    """

    model_config = ConfigDict(frozen=True, extra="allow", allow_inf_nan=False)
