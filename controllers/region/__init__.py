"""Region and optimum, AC-2016: which pairs of V and f the limits allow, and which of them is best.

    clipping         half planes and polygons of ln V and ln f
    surfaces         laws over V and f at a depth and a time, the wear put in
    allowed          limits of a file as half planes
    corners          corners, label_corners, and the best of them
    tested           whether laws were tested where they are used
    excluded         why a region is empty
    needed           which laws of a file a region needs
    points           one pair, and what the laws say of it
    visible          the region, its corners, its best and its least-worn pair
    optimum          the best pair, as the laws stand or with a demanded probability
    front            what less metal buys in wear
    sampled          laws by their draws, and the luck of one further edge
    probability      how likely a pair keeps its limits
    demanded         the best pair for a demanded probability
    usual            depth, time and the rest where a file leaves them open
    draw             the figures

Source: Alaskari & Oraby 2016, ICAESAM'2016, doi 10.15242/IIE.E1216006.

>>> from fitmodels.parameters.published import published
>>> best_point(published("AC-2016")).words.partition(", P")[0]
'V 147.9 m/min, f 0.5302 mm/rev: MRR 196028 mm3/min'
"""
