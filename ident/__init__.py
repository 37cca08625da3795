"""Dynamics: models identified from recorded runs of a machine, their validation, and PI gains designed on them."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
