"""Quantities computed from others of a file, with the formula, and their comparison with measured ones."""
