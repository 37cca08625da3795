"""From a record to coefficients: regressors, least squares, instruments, prediction errors, orders."""
