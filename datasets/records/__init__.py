"""Records: evenly sampled input and output of a machine, from a file to arrays that no regressor crosses wrongly."""
