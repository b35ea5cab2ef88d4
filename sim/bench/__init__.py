"""Scans without the arm: the test bench on which an effect is planted by its size."""

from sim.bench.planted_scan import further_scan, planted_scan

__all__ = ["further_scan", "planted_scan"]
