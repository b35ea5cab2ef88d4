"""The fit of map and effects to a scan, with intervals."""
