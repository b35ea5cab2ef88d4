"""The body as the measurement model sees it: state, compliances, discretization error."""
