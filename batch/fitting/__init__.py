"""A block of pairs -> rows of the results table (in stacks), parameter files (pair by pair), reasons and concerns.

one_pair       how a pair is fitted, alone or among thousands   block          a block -> BlockOutcome
pairs_of_rows  whose each row is, what holds anything of whom   laws_of_pairs  laws of all pairs, in stacks
table_rows     laws -> rows of the table                        pair_file      files of a pair, and its posterior
streamed_pair  a pair that is fitted as it passes by            concerns       why a pair needs attention
groups         what a pair belongs to
"""
