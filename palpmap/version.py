"""The version, in one place: packaging, recordings and `--version` read it here."""

__version__ = "0.2.0"
