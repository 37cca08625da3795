"""What to play on the machine, and what it would tell."""
