"""The measurement model: noise, effects in their order, predicted travel."""
