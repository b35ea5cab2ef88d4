"""Effects that the virtual laboratory hides in a scan: own laws, own code, none of `identify`."""

from sim.planted.catalogue import FORMS, HIDDEN, INSIDERS, OUTSIDERS

__all__ = ["FORMS", "HIDDEN", "INSIDERS", "OUTSIDERS"]
