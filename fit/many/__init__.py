"""Laws of thousands of pairs at once, and partial pooling over families of pairs.

Rows of all pairs -> sorted rows -> Gram matrices by edge -> batched fits -> ManyLaws; pairs near a numerical threshold
are fitted singly. Estimates of a family -> PooledExponents.
"""
