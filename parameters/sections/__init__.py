"""Sections of the parameter file, one frozen class each; unknown fields are kept."""
