"""The conformance kit: the checks that every effect passes."""
