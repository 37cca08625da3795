"""Wear and remaining life beside a running machine.

samples      what a source gives: `Sample`, `Notice`; the steady parts of cuts: `Window`, `CutEnd`
controller       the exported HAL controller of a file: what may be written, consent, comparison with HAL
control          by consent and behind its heartbeat: reference and feed limit of that controller
linuxcnc_control both ends of the pipe to LinuxCNC's HAL
linuxcnc_reader  readings of LinuxCNC as JSON lines, run by the machine's own Python
live_laws        laws of wear and loads of a parameter file, with the scatter between edges: `LiveLaws`
edge_scatter     scatter between edges and wander within them, from the sums of a parameter file
exposure         minutes of contact of one edge by setting, and its wear by the law
edge_state       state of one edge as a Gaussian distribution
edge_estimate    wear and remaining life of one edge by a Kalman filter: `EdgeEstimate`
decision         moment to change an edge
advice           feed and speed within limits, with their probability: `advise`
blocks           samples -> blocks of a tenth of a second, with conditions computed
cuts             blocks -> cuts, by hysteresis about the idle level: `Cuts`
windows          steady windows of a cut and means of their loads, with standard errors
edge_summary     life of one edge as learning needs it: `EdgeSummary`
learning         new versions of a parameter file, whose laws take in finished edges: `learn`, `learn_file`
detection        chipping, another tool, another batch: `Detection`
"""
