"""Shared by every package: version, errors, display, rounding, intervals, plotting, threads, files, progress."""
