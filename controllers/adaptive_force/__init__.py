"""LYAP: adaptive force control in milling, the plant it acts on, and its proof followed along a run.

    settings         what the controller takes from the file, checked
    reference_model  F_d from a set point, with F_d' and F_d''
    revolution       force and F_d averaged over a revolution of the spindle
    control          the controller: control law and adaptation (5)
    fixed_pi         the PI of the file, to hold it against
    process          drive and milling process (2.1, 2.2), depth in steps, ripple of the teeth
    recorded         the simulated run that the published estimates come from
    lyapunov         V and its matrix P along a run
    step_size        how long a step the law stands
    runs             the runs that a replay tells
    judged           settling, overshoot, steady error
    draw             figures

Source: adaptive cutting force control for CNC milling machines by Lyapunov's method (the copy used names no authors).
"""
