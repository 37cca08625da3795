"""Measured data: laboratory files read into columns with units (`Runs`, `Record`), bundled sets, plans, simulation.

    tables/         any text file or workbook -> columns; knows nothing of cutting
    reading         columns -> `Runs`, in steps over one `Draft`: roles and units (vocabulary, columns, units), shapes
                    of tables, several files, then
    plausibility/   ranges by role and process; units settled by values; cells and columns that contradict each other
    derived/        quantities computed from others, by one table of rules
    edges/          which rows belong to one cutting edge, and what contradicts itself within one
    signals/        raw records of force, power or current -> a row a cut
    records/        evenly sampled signals -> `Record`
    sets            sets printed in papers, shipped with the package; public sets that are downloaded
    design          plans of experiments; simulation: tests simulated from a law

Names are imported when they are first used, so that a reader of parameter files need not load pandas.
"""

from ..core.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
