"""The recording of a run for the Rerun viewer."""
