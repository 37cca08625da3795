"""Second-order response surfaces: term-wise tests with the right error term, selection of terms, canonical analysis."""
