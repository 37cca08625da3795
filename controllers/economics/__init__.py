"""Cost and time of a part over V and f: the settings of least cost and of greatest rate, and when to change an edge."""
