"""The built-in effects, one file an effect, and the loader of a user's own."""
