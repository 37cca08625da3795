"""Milling at constant spindle load, CLM-2023: the loop, the mill it acts on, and what a tool's life comes to.

    controller       ConstantLoad: load in, feed override out, events, tool change
    position_law     its arithmetic as LinuxCNC runs it
    incremental_law  its arithmetic as eq. 16 is worded
    settings         settings and gains of a file
    cut_model        what a cut draws and how it wears a tool, from a file
    plant            MillingCut: passes, wear, load
    passes           what each pass of a replay came to
    run              a tool from its first pass to its change; at constant feed beside it
    mixed            one tool on slot and end milling in turn
    steady           life by calculation, of one tool or over draws
    draw             the figures

Source: Tai, Tsai & Li 2023, IEEE Access, doi 10.1109/ACCESS.2023.3330587. Everything here is simulated.

>>> from fitmodels.parameters.published import published
>>> run = constant_load_run(published("CLM-2023-slot"))
>>> f"{run.wear:.0f} um after {run.length:.0f} mm"
'189 um after 1897 mm'
"""
