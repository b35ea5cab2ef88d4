"""Data of the laboratory: the arm, the body's geometry and the measured table (Scan)."""
