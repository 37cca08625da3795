"""Frequency, impulse and step responses with their confidence bands."""
