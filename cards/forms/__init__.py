"""The forms of a card: page, Markdown and data, all from one `Card`."""
