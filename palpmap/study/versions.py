"""Versions of a study: study.toml, study.v2.toml, ... Nothing is ever overwritten.

An added effect makes the next version, which names the effect with the values that were found.
`study.history.json` beside `study.toml` holds the ladder.
"""

import re
import warnings
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from identify.catalogue import CATALOGUE, file_of
from identify.effects import UNKNOWN
from identify.fit import FitResult
from models import InputError
from palpmap.study.frame import frame_shift_m
from palpmap.study.study import Effect, Study, write_study

_VERSION = re.compile(r"^(?P<stem>.+?)(?:\.v(?P<number>\d+))?\.toml$")


def version_of(
    study: Study, fit: FitResult, path: Path, files: Mapping[str, Path] | None = None
) -> Study:
    """Write a study that has the effects of a fit, starting from its values; return it.

    Their places are in the scan's frame there, as those of the map.

    Parameters
    ----------
    files : of the user's own effects, by name; where they stand now, whatever the study's folder.
        One that stands in no file cannot be named: a warning says so
    """
    kept = {entry.name: entry.file for entry in study.effects}
    origin_m = np.array(study.body.origin_m)
    known = {**kept, **{name: file.resolve() for name, file in (files or {}).items()}}
    entries = []
    for part in fit.model.effects:
        effect = part.effect
        if effect.family == UNKNOWN:
            continue
        own = effect not in CATALOGUE
        file = known.get(effect.name) or (file_of(effect) if own else None)
        if own and file is None:
            warnings.warn(
                f"{path} does not name the effect '{effect.name}': its class stands in no Python "
                "file of its own; put it in one and import it from there",
                stacklevel=2,
            )
            continue
        initial = {
            name: float(value) + frame_shift_m(f"{effect.name}.{name}", origin_m)
            for name, value in fit.at.values[effect.name].items()
        }
        entries.append(Effect(name=effect.name, file=file, initial=initial))
    changed = study.model_copy(update={"effects": tuple(entries)})
    write_study(changed, path)
    return changed


def next_version(path: Path) -> Path:
    """Return the path of the first version that does not exist yet.

    >>> next_version(Path("nowhere/study.v2.toml")).as_posix()
    'nowhere/study.v3.toml'
    """
    match = _VERSION.match(path.name)
    if match is None:
        raise InputError(f"{path}: expected a study file (.toml)")
    number = int(match["number"] or 1) + 1
    while (target := path.with_name(f"{match['stem']}.v{number}.toml")).exists():
        number += 1
    return target


def history_file(path: Path) -> Path:
    """Return the file that holds the ladder of a study and its versions."""
    match = _VERSION.match(path.name)
    if match is None:
        raise InputError(f"{path}: expected a study file (.toml)")
    return path.with_name(f"{match['stem']}.history.json")
