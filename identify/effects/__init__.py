"""Effects: base class, parameters and readings."""
