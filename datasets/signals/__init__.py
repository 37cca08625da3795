"""Raw signals of cutting tests: records of forces, power or current -> one row a cut, joined to the table of tests."""
