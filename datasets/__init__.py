"""Measured data: laboratory files read into columns with units (`Runs`, `Record`), bundled sets, plans, simulation.

    reading      a table of tests -> `Runs`; vocabulary and columns name them, units and coded levels convert them
    tables/      any text file or workbook -> columns; knows nothing of cutting
    records/     evenly sampled signals -> `Record`
    bundles      sets printed in papers, shipped with the package; fetching: public sets that are downloaded
    design       plans of experiments; simulation: tests simulated from a law

Names are imported when they are first used, so that a reader of parameter files need not load pandas.
"""

from ..core.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
