"""Numbers as they are told: see ``datasets.rounding``, which every room shares."""

from ..datasets.rounding import EXACT, decimals, p_value, plain, told

__all__ = ["EXACT", "decimals", "p_value", "plain", "told"]
