"""A user's own effect, from a Python file."""

import ast
import importlib.util
import inspect
import os
import sys
from pathlib import Path
from types import ModuleType

from identify.catalogue.catalogue import CATALOGUE
from identify.catalogue.guarded import guard_methods, guarded
from identify.effects.base import Effect
from identify.effects.hook import hook_fault
from models import InputError

_DEMANDED = (
    "name", "title", "summary", "formula", "source", "gives_away", "cure", "parameters",
)  # fmt: skip
_NO_EFFECT = (
    "defines no effect; expected one class derived from Effect "
    "(from palpmap import Effect, EffectParameter, WorkedExample)"
)


def load_effect(path: str | os.PathLike[str]) -> Effect:
    """Return the effect in a Python file. The file's code is executed.

    Raises
    ------
    InputError
        There is no such file, its execution fails, it defines no effect or several, the effect
        lacks an attribute, has a wrong hook or the name of a built-in one.
    """
    path = Path(path)
    _parsed(path)
    module = _executed(path)
    own = _defined_in(module)
    if not own:
        raise InputError(f"{path}: {_NO_EFFECT}")
    if len(own) > 1:
        names = ", ".join(kind.__name__ for kind in own)
        raise InputError(f"{path}: defines {len(own)} effects ({names}), expected one a file")
    return _instance(own[0], path)


def file_of(effect: Effect) -> Path | None:
    """Return the file that `load_effect` makes an imported effect from, None where there is none.

    A class of the running program has none: to load it would run the program once more.
    """
    module = sys.modules.get(type(effect).__module__)
    file = getattr(module, "__file__", None)
    if module is None or file is None or module.__name__ == "__main__":
        return None
    return Path(file).resolve() if _defined_in(module) == [type(effect)] else None


def _defined_in(module: ModuleType) -> list[type[Effect]]:
    return [
        kind
        for kind in vars(module).values()
        if inspect.isclass(kind) and issubclass(kind, Effect) and kind.__module__ == module.__name__
    ]


def refuse_effect_file(path: Path) -> None:
    """Refuse a file that is missing, no Python or without a class; its code is not executed.

    Raises
    ------
    InputError
        Naming the file and, for faulty Python, the line.
    """
    if not any(isinstance(node, ast.ClassDef) for node in ast.walk(_parsed(path))):
        raise InputError(f"{path}: {_NO_EFFECT}")


def _parsed(path: Path) -> ast.Module:
    if path.suffix != ".py":
        raise InputError(f"{path}: expected a Python file (.py) that defines one effect")
    if not path.is_file():
        raise InputError(f"{path}: no such file; check the path")
    try:
        return ast.parse(path.read_bytes())
    except SyntaxError as error:
        raise InputError(f"{path}, line {error.lineno}: {error.msg}") from error
    except (ValueError, RecursionError, MemoryError) as error:
        raise InputError(f"{path}: found a file that is no Python ({error})") from error


def _executed(path: Path) -> ModuleType:
    spec = importlib.util.spec_from_file_location(f"palpmap_own_effect_{path.stem}", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses and pickle look there
    with guarded(path, "the file"):
        spec.loader.exec_module(module)
    return module


def _instance(kind: type[Effect], path: Path) -> Effect:
    missing = [name for name in _DEMANDED if not hasattr(kind, name)]
    if missing:
        raise InputError(f"{path}: {kind.__name__} has no {', '.join(missing)}")
    fault = hook_fault(kind)
    if fault:
        raise InputError(f"{path}: {fault}")
    if any(kind.name == built_in.name for built_in in CATALOGUE):
        raise InputError(
            f"{path}: {kind.__name__} is called '{kind.name}', as a built-in effect is; "
            "give it another name"
        )
    guard_methods(kind, path)
    with guarded(path, f"{kind.__name__}(), made without arguments,"):
        return kind()
