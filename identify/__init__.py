"""From a Scan to the stiffness map: distribution map, fit, comparison, uncertainty."""
