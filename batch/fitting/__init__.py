"""A block of pairs -> rows of the results table (batched), parameter files (pair by pair), reasons and concerns.

block      a block -> BlockOutcome                  pair_laws      the laws of all pairs of a block
pair_file  files of a pair, and its posterior       streamed_pair  a pair with more rows than memory
concerns   why a pair needs attention; its groups
"""
