"""The sections of the parameter file: one class each, all of them frozen, keeping what they do not know."""
