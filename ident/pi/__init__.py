"""PI control: gains, loops, figures of merit, tuning to a specification, simulation."""
