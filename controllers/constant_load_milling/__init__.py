"""Milling at constant spindle load, CLM-2023: the control loop, its plant, and tool life.

    controller    ConstantLoad: load in, feed override out, events, tool change
    states        its states: condition, feed and time of each
    control_laws  PI in position form and as eq. 16 is worded; settings of a file
    cut_model     load and tool wear of a cut, from a file
    plant         MillingCut: passes, wear, load
    runs          a tool from its first pass to its change, at constant load and at constant feed
    mixed_path    one tool on slot and end milling in turn
    steady        life by calculation, of one tool or over draws
    figures       the figures

Source: Tai, Tsai & Li 2023, IEEE Access, doi 10.1109/ACCESS.2023.3330587. Everything here is simulated.

>>> from fitmodels.controllers import constant_load_run
>>> from fitmodels.parameters.published import published
>>> run = constant_load_run(published("CLM-2023-slot"))
>>> f"{run.wear:.0f} um after {run.length:.0f} mm"
'189 um after 1896 mm'
"""
