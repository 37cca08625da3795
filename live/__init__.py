"""Wear and remaining life beside a running machine.

samples      what a source gives: `Sample`, `Notice`; the steady parts of cuts: `Window`, `CutEnd`
control      reference and feed limit of the exported controller, by consent and behind its heartbeat
linuxcnc_control    both ends of the pipe to LinuxCNC's HAL
"""
