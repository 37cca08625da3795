"""Whether a file may be handed to a controller: one kind of question a file."""
