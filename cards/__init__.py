"""What is told: the model card, its figures, and what the command prints."""

from .card import markdown
from .folder import FILES, write

__all__ = ["FILES", "markdown", "write"]
