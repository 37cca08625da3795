"""Estimators of discrete transfer functions: ARX, SRIV, output error, ARMAX; selection of their orders."""
