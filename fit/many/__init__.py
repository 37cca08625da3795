"""Laws of thousands of pairs at once, and partial pooling over families of pairs.

Rows of all pairs -> sorted rows -> batched QR -> standard errors by edge -> ManyLaws; pairs near a numerical threshold
are fitted singly. Estimates of a family -> PooledExponents.
"""
