"""Checks of a law by topic; ``judgement`` runs all of them."""
