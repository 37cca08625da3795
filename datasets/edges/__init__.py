"""Cutting edges: which rows belong to one edge, and what contradicts itself within an edge."""
