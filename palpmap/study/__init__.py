"""The study: what is known of an experiment, read, checked and opened."""
