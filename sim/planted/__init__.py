"""Effects that the virtual laboratory hides in a scan: own laws, own code, none of `identify`."""
