from .folder import files as files
from .folder import markdown as markdown
from .folder import write as write
from .publishing import site as site

__all__ = ["files", "markdown", "site", "write"]
