"""The body that is really there: soft body, its hidden truth, its true map."""
