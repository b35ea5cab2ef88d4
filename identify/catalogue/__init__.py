"""The built-in effects, one file an effect, and the loader of a user's own."""

from identify.catalogue.catalogue import CATALOGUE
from identify.catalogue.contained import contains_its_special_cases
from identify.catalogue.user_effect import file_of, load_effect, refuse_effect_file

__all__ = [
    "CATALOGUE",
    "contains_its_special_cases",
    "file_of",
    "load_effect",
    "refuse_effect_file",
]
