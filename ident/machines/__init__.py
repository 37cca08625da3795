"""Models of machines with a name: steps, continuous forms, drives, the force process."""
