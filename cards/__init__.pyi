from .folder import files as files
from .folder import write as write
from .forms.page import profiler as profiler
from .publishing import site as site

__all__ = ["files", "profiler", "site", "write"]
