"""Validation of a model on a record: simulation, k-step prediction, residual tests."""
