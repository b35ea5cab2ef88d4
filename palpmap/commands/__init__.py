"""The work of the commands, behind their command lines in `palpmap.cli`."""
