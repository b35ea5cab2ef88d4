"""Run folders: files and pictures that a fit or an explanation leaves."""
