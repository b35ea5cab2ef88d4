"""Who may import whom: read from the source, imports inside functions included."""

import ast
import sys
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
OURS = ("models", "fem", "sim", "identify", "palpmap")
ALLOWED = {
    "models": {"numpy", "pyarrow"},
    "fem": {"numpy", "scipy", "numba", "pypardiso", "pytetwild", "pyvista"},
    "sim": {"models", "numpy", "scipy", "mujoco", "pinocchio"},
    "identify": {"models", "fem", "numpy", "scipy"},
}
FEM_DOOR_OF_SIM = "sim.body.soft_body"


def modules(root: Path) -> dict[str, ast.Module]:
    """Every module of ours by dotted name; a package stands under its own name."""
    found = {}
    for package in OURS:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            found[name] = ast.parse(path.read_text(encoding="utf-8"), str(path))
    return found


def imports(tree: ast.Module, name: str, known: set[str]) -> Iterator[tuple[str, int]]:
    """What a module imports, as the most precise module name, with its line.

    Imports for type checking only are left out: they do not happen.
    """
    skipped = {
        id(inner)
        for node in ast.walk(tree)
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for part in node.body
        for inner in ast.walk(part)
    }
    for node in ast.walk(tree):
        if id(node) in skipped:
            continue
        if isinstance(node, ast.Import):
            for alias in node.names:
                yield alias.name, node.lineno
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                above = name.split(".")[: -node.level]
                base = ".".join([*above, *filter(None, [node.module])])
            for alias in node.names:
                inner = f"{base}.{alias.name}"
                yield (inner if inner in known else base), node.lineno


def forbidden_imports(root: Path) -> list[str]:
    found = modules(root)
    breaches = []
    for name, tree in found.items():
        home = name.split(".")[0]
        allowed = ALLOWED.get(home)
        if allowed is None:
            continue
        for target, line in imports(tree, name, set(found)):
            top = target.split(".")[0]
            door = name == FEM_DOOR_OF_SIM and top == "fem"
            if top not in {home} | allowed and top not in sys.stdlib_module_names and not door:
                breaches.append(f"{name}, line {line}: imports {target}")
    return breaches


def prints(root: Path) -> list[str]:
    return [
        f"{name}, line {node.lineno}: prints"
        for name, tree in modules(root).items()
        for node in ast.walk(tree)
        if isinstance(node, ast.Call)
        and (
            ast.unparse(node.func) == "print"
            or (
                ast.unparse(node.func) in ("sys.stdout.write", "sys.stderr.write")
                and not name.startswith("palpmap")
            )
        )
    ]


def cycle(root: Path) -> list[str]:
    """Modules of one import cycle, or nothing."""
    found = modules(root)
    graph = {
        name: {target for target, _ in imports(tree, name, set(found)) if target in found}
        for name, tree in found.items()
    }
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def test_each_package_imports_only_what_it_may():
    assert forbidden_imports(ROOT) == []


def test_no_modules_import_each_other_in_a_circle():
    assert cycle(ROOT) == []


def test_the_library_does_not_print():
    assert prints(ROOT) == []


def test_the_tests_look_at_every_package():
    names = set(modules(ROOT))
    assert set(OURS) <= names
    assert {"models.scan", "palpmap.cli.check"} <= names


@pytest.mark.parametrize(
    ("path", "source", "breach"),
    [
        ("models/a.py", "import scipy.sparse", "models.a, line 1: imports scipy.sparse"),
        ("models/a.py", "def f():\n    import fem", "models.a, line 2: imports fem"),
        ("models/a.py", "from fem import mesh", "models.a, line 1: imports fem"),
        ("fem/a.py", "from models.scan import Scan", "fem.a, line 1: imports models.scan"),
        ("fem/a.py", "import typer", "fem.a, line 1: imports typer"),
        ("sim/a.py", "import fem", "sim.a, line 1: imports fem"),
        (
            "sim/body/soft_body.py",
            "import fem\nimport identify",
            "sim.body.soft_body, line 2: imports ident",
        ),
        ("identify/a.py", "def f():\n    from sim import x", "identify.a, line 2: imports sim"),
        (
            "identify/a.py",
            "import palpmap.study.study",
            "identify.a, line 1: imports palpmap.study.study",
        ),
        ("identify/deep/a.py", "from ...sim import x", "identify.deep.a, line 1: imports sim"),
    ],
)
def test_a_forbidden_import_is_found(path, source, breach, tmp_path):
    file = tmp_path / path
    file.parent.mkdir(parents=True)
    file.write_text(source)
    (found,) = forbidden_imports(tmp_path)
    assert found.startswith(breach)


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("sim/body/soft_body.py", "import fem.mesh.mesh\nimport mujoco, pinocchio, json"),
        ("identify/a.py", "from fem import mesh\nfrom models.scan import Scan\nfrom . import b"),
        ("palpmap/a.py", "import sim, identify, rerun, typer"),
    ],
)
def test_what_is_allowed_is_no_breach(path, source, tmp_path):
    file = tmp_path / path
    file.parent.mkdir(parents=True)
    file.write_text(source)
    assert forbidden_imports(tmp_path) == []


@pytest.mark.parametrize(
    "line", ["from fem.a import x", "from fem import a", "def f():\n    import fem.a"]
)
def test_a_circle_is_found(line, tmp_path):
    (tmp_path / "fem").mkdir()
    (tmp_path / "fem" / "__init__.py").touch()
    (tmp_path / "fem" / "a.py").write_text("from .b import y")
    (tmp_path / "fem" / "b.py").write_text(line)
    assert set(cycle(tmp_path)) == {"fem.a", "fem.b"}


@pytest.mark.parametrize(
    ("path", "source", "count"),
    [
        ("fem/a.py", "def f():\n    print(1)", 1),
        ("fem/a.py", "import sys\nsys.stdout.write('1')", 1),
        ("palpmap/a.py", "print(1)", 1),
        ("palpmap/a.py", "import sys\nsys.stdout.write('1')", 0),
        ("fem/a.py", "pprint(1)", 0),
    ],
)
def test_a_print_is_found(path, source, count, tmp_path):
    file = tmp_path / path
    file.parent.mkdir()
    file.write_text(source)
    assert len(prints(tmp_path)) == count
