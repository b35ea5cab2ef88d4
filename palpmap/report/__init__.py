"""The report of a run: HTML page and console tables."""
