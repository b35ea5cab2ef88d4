"""The result of a run as it is shown: records, tables, words."""
