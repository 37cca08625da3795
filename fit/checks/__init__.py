"""Is a law good enough to use: every check of it, one a file, and what they say together (``judgement``)."""
