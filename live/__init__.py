"""Wear and remaining life beside a running machine.

samples      what a source gives: `Sample`, `Notice`; the steady parts of cuts: `Window`, `CutEnd`
"""
