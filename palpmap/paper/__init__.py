"""The six tests of the paper, repeated on its own mesh."""
