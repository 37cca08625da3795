"""Region and optimum, AC-2016: the pairs of V and f within the limits, and the best of them.

    half_planes      half planes and polygons of ln V and ln f
    log_planes       power laws over V and f at a depth and a time, with the wear substituted
    limits           limits of a file on V and f, and the laws they need
    operating_point  one pair of V and f with its responses; corners of a region
    visible          the region, its best and its least-wear pair, wear against removal rate
    sampled_laws     laws by their draws, with the deviation of a new edge
    probability      probability that a pair keeps its limits, and the best pair at a required probability
    surfaces         laws of any form over V and f, and limits on them
    curved           corners and best pair within curves, by search
    figures          the figures

Source: Alaskari & Oraby 2016, ICAESAM'2016, doi 10.15242/IIE.E1216006.

>>> from fitmodels.controllers import best_point
>>> from fitmodels.parameters.published import published
>>> best_point(published("AC-2016")).words.partition(", P")[0]
'V 147.9 m/min, f 0.5302 mm/rev: MRR 196028 mm3/min'
"""
