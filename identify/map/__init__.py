"""The map of Young's modulus: background and Gaussian inclusions, parameters, initial guess."""
