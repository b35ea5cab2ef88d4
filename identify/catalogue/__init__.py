"""The built-in effects, one file an effect, and the loader of a user's own."""

from identify.catalogue.catalogue import CATALOGUE
from identify.catalogue.user_effect import load_effect, refuse_effect_file

__all__ = ["CATALOGUE", "load_effect", "refuse_effect_file"]
