"""Recursive turning to the end of an edge: AC-2017 (Alaskari and Oraby, Kuwait J. Sci., accepted June 2017).

    laws          the laws of an edge's life at one depth of cut, with their limits
    from_file     ... taken from a parameter file, or why they cannot be
    rules         how wear adds up and which times count: as published, and the other readings
    grid          the pairs that are tried and what each would do in an interval
    choice        one interval's pair, from the grid or exact
    optimum       the exact optimum of an interval, by cutting planes
    life          the whole recursion, and a plan carried out on another edge
    fixed         one pair to the end of an edge, and the comparison
    controller    the recursion as a controller, an interval a step
    edge          the plant: an edge that wears
    many          the recursion for a thousand draws at once
    distribution  the distribution of life and of metal removed
    draw          figures

>>> from fitmodels.controllers.recursion import life_laws, whole_life
>>> from fitmodels.parameters.published import published
>>> whole_life(life_laws(published("AC-2017"))).minutes
14.0
"""
