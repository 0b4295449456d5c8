"""Naris: start a registration of endoscopy to CT without a human. Research use only."""

__version__ = "0.1.0"
