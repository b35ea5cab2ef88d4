"""The study: the known facts of an experiment, read, checked and opened."""
