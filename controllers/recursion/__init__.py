"""Recursive turning to the end of an edge: AC-2017 (Alaskari and Oraby, Kuwait J. Sci., accepted June 2017).

    laws              laws and limits of an edge's life at one depth of cut; rules of wear and time
    from_file         these laws from a parameter file
    interval_optimum  the best pair of one interval, from the published grid or exact
    life              the whole recursion, a plan on another edge, a fixed pair, and their comparison
    controller        the recursion as a controller, one interval a step, and its plant
    distribution      the distribution of life and of metal removed under uncertain laws
    figures           the figures

>>> from fitmodels.controllers import life_laws, whole_life
>>> from fitmodels.parameters.published import published
>>> whole_life(life_laws(published("AC-2017"))).minutes
14.0
"""
