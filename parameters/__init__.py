"""The parameter file: laws, dynamics, gains and settings of one tool and work material; it predicts on its own.

    file          the whole file: read and write; file_format: strict JSON, checksum, versions; json_schema: its schema
    sections/     one class per section: identity, design, laws, posterior, dynamics, gains, settings, limits ...
    draws         posterior draws in a file next to the parameter file
    messages      validation errors of the schema as sentences

    evaluation    values and intervals of a law; prediction: the same as one sentence
    setting_rules a load law and wear tests -> settings of milling at constant load; setting_words: sentences on them

    collection    results -> a parameter file; gather/ holds one kind of result per module
    checks/       tests that a file must pass before a controller loads it
    exports/      formats that controllers load
    published/    values printed in papers as parameter files
    display, figures    what is shown of these classes, registered per class

>>> from fitmodels import parameters
>>> pf = parameters.collect(tool="GC435", work="709M40", laws=[])
>>> pf.schema_version
'fitmodels.parameters/10'
"""

from ..core.lazy import lazy_names

__getattr__, __dir__, __all__ = lazy_names(__name__, __file__)
