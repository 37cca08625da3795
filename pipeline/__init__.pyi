from .analysis import Analysis as Analysis
from .analysis import analyse as analyse
from .options import FitOptions as FitOptions

__all__ = ["Analysis", "FitOptions", "analyse"]
