"""Plausibility of tests: ranges by role and process, units settled by values, contradictions between columns."""
