"""The main job, once for the command, batch and notebooks: tests of tool/work pairs -> laws, checks, parameter files.

options    how a file is read and how laws are fitted, validated once
reading    a path, a DataFrame or Runs -> Runs
pair       the runs of one pair -> laws, tool life, posteriors, parameter file
analysis   `analyse`: all pairs of a source
folders    one folder for each pair, written whole or not at all
"""

from ..core.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
