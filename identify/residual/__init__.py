"""Analysis of the residual: noise or structure, and the direction of the structure."""
