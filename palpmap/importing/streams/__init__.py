"""A raw stream of force and pose cut into presses."""
