"""The version, in one place: packaging, recordings and `--version` read it here."""

__version__ = "0.1.0"
