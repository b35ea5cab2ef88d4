"""Design of scans: detection limits, undetected bias, next presses."""
