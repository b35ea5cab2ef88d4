"""The commands, one file each: options and help; the work is done elsewhere in palpmap."""
