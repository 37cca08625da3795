"""Dynamics: models identified from recorded runs of a machine, their validation, and PI gains designed on them."""

from ..core.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
