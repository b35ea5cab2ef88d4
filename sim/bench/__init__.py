"""Scans without the arm: the test bench on which an effect is planted by its size."""
