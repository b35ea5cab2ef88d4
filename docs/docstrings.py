"""Reads `name : meaning` in a docstring as the meaning of the name, not as its type."""

import re

import griffe


class Meanings(griffe.Extension):
    """Puts the meaning of a parameter on the line below its name, where numpydoc looks for it."""

    def on_instance(self, *, obj, **_):
        """Rewrite one docstring."""
        if obj.docstring is not None:
            text = obj.docstring.value
            obj.docstring.value = re.sub(r"(?m)^(\w+(?:, \w+)*) : (.+)$", r"\1\n    \2", text)
