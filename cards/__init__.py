"""What is told: the model card, its figures, and what the command prints."""

from .card import markdown
from .folder import FILES, files, write

__all__ = ["FILES", "files", "markdown", "write"]
