"""Turning at constant roughness through constant force (SURF): the controller, its cut, and the paper's simulations.

    reference      the force that gives a roughness, in both readings of the lost equation
    control        the feed law on the servo's output, its limits, and when it does not act
    plant          servo, cut, and force disturbed at random
    stability      what the loop does by theory, and why the command reading swings
    cuts           one simulated cut, with or without control, and its figures in steady cut
    table          the eight simulations of Table 1
    draw           pictures

Made from a parameter file alone; what fills the paper's gaps is called a reconstruction where it stands.

>>> from fitmodels.controllers import roughness
>>> roughness.ConstantRoughness.__name__
'ConstantRoughness'
"""
