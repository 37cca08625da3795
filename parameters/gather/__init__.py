"""Results become sections: one kind of result a file."""
