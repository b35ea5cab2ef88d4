"""The residual: is it noise, and if not, along what does it vary."""
