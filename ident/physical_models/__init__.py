"""Physical models fitted to records: feed drive, cutting force process, step responses."""

NOT_HELD_OUT = "Simulation of samples not fitted: all samples of the record are fitted"
