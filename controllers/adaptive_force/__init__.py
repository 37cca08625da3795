"""LYAP: adaptive force control in milling, the plant it acts on, and its stability proof along a run.

    settings    settings of the controller from the file, validated
    signals     reference model, averages over a revolution, regulation metrics
    controller  the adaptive controller: control law and adaptation (5)
    fixed_pi    the PI of the file, for comparison
    plant       drive and milling process (2.1, 2.2), depth in steps, ripple of the teeth
    stability   the Lyapunov function V along a run, and the step size of the law
    runs        simulated runs at constant depth and with steps of depth
    figures     the figures

Source: adaptive cutting force control for CNC milling machines by Lyapunov's method (the copy used names no authors).
"""
