"""The application: study files, command line, recording, report."""

__version__ = "0.1.0"
