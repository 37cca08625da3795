"""A parameter file becomes its card in Markdown, in one step."""

from pathlib import Path

from ..parameters import ParameterFile
from .content.parts import Publication


def markdown(pf: ParameterFile, *, folder: Path | None = None, publication: Publication | None = None) -> str:
    """The card of a parameter file as README.md, schema ``fitmodels.card/1``: Markdown with a YAML head.

    Parameters
    ----------
    pf : ParameterFile
    folder : path, optional
        Where the card stands, for the pictures in ``figures`` beside it.
    publication : Publication, optional
        Licence, authors and so on, as ``card.toml`` has them.

    Examples
    --------
    >>> from fitmodels import cards, parameters
    >>> "# GC435 on 709M40" in cards.markdown(parameters.collect(tool="GC435", work="709M40"))
    True
    """
    from .content.compose import compose
    from .forms.markdown import markdown as as_markdown

    return as_markdown(compose(pf, publication=publication, folder=folder))
