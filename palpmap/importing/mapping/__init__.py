"""The mapping rig.toml, and the columns that it names."""
