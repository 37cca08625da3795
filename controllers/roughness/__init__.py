"""Turning at constant roughness through constant force (SURF): the controller, its plant, and the paper's simulations.

    reference    the force that gives a roughness, in both readings of the missing equation
    controller   the feed law on the servo's output, its limits, and its conditions
    plant        servo, cut and random disturbance of the force; linear theory of the loop
    simulations  one simulated cut, with or without control, its metrics; the eight simulations of Table 1
    figures      the figures

Made from a parameter file alone; assumptions that fill gaps of the paper are marked as reconstructions.

>>> from fitmodels import controllers
>>> controllers.ConstantRoughness.__name__
'ConstantRoughness'
"""
