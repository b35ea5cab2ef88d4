"""A console that a command outlives: where nobody reads on, it falls silent."""

import os

from rich.console import Console


class LastingConsole(Console):
    """A console whose reader may leave, as in `palpmap explain ... 2>&1 | head`.

    The command goes on to its files; a long run is not lost for a line that nobody reads.
    """

    def on_broken_pipe(self) -> None:
        """Write to nowhere from now on."""
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, self.file.fileno())
        os.close(nowhere)
