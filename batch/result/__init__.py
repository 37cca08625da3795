"""What is made of outcomes: records to go on from, files of the pairs, tables, and who needs attention.

BlockOutcome -> files of its pairs and a record (``records``, in the folder that ``place`` keeps) -> a row a pair and
law (``table``) -> families (``comparison``, ``draw``) -> pairs that need attention (``attention``).
"""
