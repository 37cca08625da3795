"""The content of a card, before it has a form: parameter file -> `Card`."""
