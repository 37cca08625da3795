from .folder import files as files
from .folder import write as write
from .publishing import site as site

__all__ = ["files", "site", "write"]
