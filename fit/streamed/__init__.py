"""One power law over more rows than memory holds: chunks -> blocks -> sums -> StreamedLaw."""
