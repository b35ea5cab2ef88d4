"""A whole scan by the arm: program, presses, first touch, result."""
