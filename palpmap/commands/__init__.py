"""What the commands do, behind their command lines in `palpmap.cli`."""
