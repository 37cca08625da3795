"""Laws of thousands of pairs at once, and what a family of pairs says of each of them.

Rows of all pairs -> sorted rows -> stacks of equal length -> triangles -> standard errors by edge -> ManyLaws;
whatever a stack cannot settle beyond doubt is fitted one by one. Estimates of a family -> PooledExponents.
"""
