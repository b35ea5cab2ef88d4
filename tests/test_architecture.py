"""Who may import whom: read from the source, imports inside functions included."""

import ast
import sys
from collections import Counter
from collections.abc import Container, Iterator
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).parent.parent
OURS = ("models", "fem", "sim", "identify", "palpmap")
ALLOWED = {
    "models": {"numpy", "pyarrow"},
    "fem": {"numpy", "scipy", "numba", "pypardiso", "pytetwild", "pyvista"},
    "sim": {"models", "numpy", "scipy", "numba", "mujoco", "pinocchio", "coal"},
    "identify": {"models", "fem", "numpy", "scipy", "numba", "arviz_base", "arviz_stats"},
}
FEM_DOORS_OF_SIM = ("sim.body.block_compliance", "sim.body.soft_body")
ORDER = {
    "models": (),
    "fem": (
        "mesh", "linear", "contact", "near_field", "solve", "palpation", "reduced",
        "finite_strain",
    ),
    "sim": ("robot", "motion", "body", "planted", "bench", "scan"),
    "identify": (
        "optimize", "map", "body", "effects", "effects.conformance", "catalogue", "measurement",
        "fit.free_map", "fit", "residual", "select", "design",
    ),
    "palpmap": (
        "study", "importing.readers", "importing.mapping", "importing.streams", "importing",
        "experiment", "arguments", "result", "figures", "report", "recording", "run_files",
        "results", "prediction_results", "selection_results", "sides", "selection", "export", "api",
        "robot", "paper", "commands", "blind", "cli",
    ),
}  # fmt: skip
"""Folders and modules of each package: one imports from itself and from those before it."""
GROUND = {
    "fem.arrays",
    "fem.errors",
    "palpmap.console",
    "palpmap.progress",
    "palpmap.record",
    "palpmap.run_folder",
    "palpmap.units",
    "palpmap.version",
}
"""Modules outside the folders that every folder of their package may import."""
ENGINE = tuple(
    f"identify.{folder}"
    for folder in (
        "optimize", "map", "body", "effects", "measurement", "fit", "residual", "select",
        "design", "settings",
    )
)  # fmt: skip
"""Folders that never import the catalogue: the caller hands the effects in."""
SHOWING = ("palpmap.result", "palpmap.figures", "palpmap.report", "palpmap.recording")
SOLVING = {"fit_jointly", "PalpationModel", "linearise"}
"""Calls of the engine that folders which only show what was found never make."""
DECIDING = ("fem", "identify.fit", "identify.select", "identify.design", "identify.optimize")
"""Packages of which those folders take types and constants alone, no function."""
LOOKED_AT = (ast.Module, ast.Import, ast.ImportFrom, ast.Call, ast.If)
Nodes = tuple[Any, ...]
MOST_MODULES = 20
LONG_FOLDERS = {"identify/catalogue"}


@cache
def modules(root: Path) -> dict[str, Nodes]:
    """What the rules look at of every module of ours, by dotted name, the module itself first.

    A package stands under its own name.
    """
    found = {}
    for package in OURS:
        for path in sorted((root / package).rglob("*.py")):
            parts = path.relative_to(root).with_suffix("").parts
            name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
            nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            found[name] = tuple(node for node in nodes if isinstance(node, LOOKED_AT))
    return found


def imports(nodes: Nodes, name: str, known: Container[str]) -> Iterator[tuple[str, int]]:
    """What a module imports, types only included, as the most precise module name, with line."""
    for node in nodes:
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


def folder(name: str) -> tuple[str, int] | None:
    """Return a module's package and the place of its folder in the order, None outside folders."""
    package, _, rest = name.partition(".")
    inside = [f for f in ORDER.get(package, ()) if f"{rest}.".startswith(f"{f}.")]
    return (package, ORDER[package].index(max(inside, key=len))) if inside else None


def wrong_order(root: Path) -> list[str]:
    """Imports from a folder that comes later, or of what a folder may never import."""
    found = modules(root)
    breaches = []
    for name, nodes in found.items():
        here = folder(name)
        for target, line in imports(nodes, name, found):
            there = folder(target)
            upwards = here and there and here[0] == there[0] and there[1] > here[1]
            own = here and target.split(".")[0] == here[0]
            face = own and there is None and target in found and target not in GROUND
            catalogue = name.startswith(ENGINE) and target.startswith("identify.catalogue")
            if upwards or face or catalogue:
                breaches.append(f"{name}, line {line}: imports {target}")
    return breaches


def crowded(root: Path) -> list[str]:
    """Folders with too many modules, `__init__` not counted."""
    folders = Counter(
        path.parent.relative_to(root).as_posix()
        for package in OURS
        for path in (root / package).rglob("*.py")
        if path.name != "__init__.py"
    )
    return [f for f, count in folders.items() if count > MOST_MODULES and f not in LONG_FOLDERS]


def forbidden_imports(root: Path) -> list[str]:
    found = modules(root)
    breaches = []
    for name, nodes in found.items():
        home = name.split(".")[0]
        allowed = ALLOWED.get(home)
        if allowed is None:
            continue
        for target, line in imports(nodes, name, found):
            top = target.split(".")[0]
            door = name in FEM_DOORS_OF_SIM and top == "fem"
            if top not in {home} | allowed and top not in sys.stdlib_module_names and not door:
                breaches.append(f"{name}, line {line}: imports {target}")
    return breaches


def side_doors(root: Path) -> list[str]:
    """Imports from a module inside a folder of another package, past the folder's `__init__`."""
    found = modules(root)
    folders = set(OURS) | {f"{package}.{f}" for package in ORDER for f in ORDER[package]}
    shown = {
        name: {alias.asname or alias.name for node in found[name][0].body
               if isinstance(node, ast.ImportFrom) for alias in node.names}
        for name in folders & set(found)
    }  # fmt: skip
    breaches = []
    for name, nodes in found.items():
        for node in nodes:
            targets = []
            if isinstance(node, ast.Import):
                targets = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom) and not node.level and node.module:
                inside = [alias.name for alias in node.names
                          if alias.name not in shown.get(node.module, ())]  # fmt: skip
                targets = [node.module, *(f"{node.module}.{alias}" for alias in inside)]
            breaches += [
                f"{name}, line {node.lineno}: imports {target}"
                for target in targets
                if target in found and target not in folders
                and target.split(".")[0] != name.split(".")[0]
            ]  # fmt: skip
    return breaches


def prints(root: Path) -> list[str]:
    return [
        f"{name}, line {node.lineno}: prints"
        for name, nodes in modules(root).items()
        for node in nodes
        if isinstance(node, ast.Call)
        and (
            ast.unparse(node.func) == "print"
            or (
                ast.unparse(node.func) in ("sys.stdout.write", "sys.stderr.write")
                and not name.startswith("palpmap")
            )
        )
    ]


def types_only(nodes: Nodes) -> set[str]:
    """Modules that are imported for type checking only."""
    return {
        part.module
        for node in nodes
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"
        for part in node.body
        if isinstance(part, ast.ImportFrom) and part.module
    }


def cycle(root: Path) -> list[str]:
    """Modules of one import cycle, or nothing; two of one folder may name each other's types."""
    found = modules(root)
    graph = {
        name: {target for target, _ in imports(nodes, name, found) if target in found}
        - {
            target
            for target in types_only(nodes)
            if target.rpartition(".")[0] == name.rpartition(".")[0]
        }
        for name, nodes in found.items()
    }
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        return error.args[1]
    return []


def decisions(root: Path) -> list[str]:
    """Calls that solve, and verdicts that are changed, in the folders that only show."""
    return [
        f"{name}, line {node.lineno}: {ast.unparse(node.func)}"
        for name, nodes in modules(root).items()
        if f"{name}.".startswith(tuple(f"{folder}." for folder in SHOWING))
        for node in nodes
        if isinstance(node, ast.Call)
        and (
            ast.unparse(node.func).rpartition(".")[2] in SOLVING
            or any(_decides(node, keyword) for keyword in node.keywords)
        )
    ] + [
        f"{name}, line {node.lineno}: {alias.name}"
        for name, nodes in modules(root).items()
        if f"{name}.".startswith(tuple(f"{folder}." for folder in SHOWING))
        for node in nodes
        if isinstance(node, ast.ImportFrom)
        and f"{node.module}.".startswith(tuple(f"{package}." for package in DECIDING))
        for alias in node.names
        if alias.name.islower()
    ]


def _decides(call: ast.Call, keyword: ast.keyword) -> bool:
    """Whether a call sets a verdict, and does not copy one into the record of a file."""
    copied = isinstance(keyword.value, ast.Attribute) and keyword.value.attr == "verdict"
    record = ast.unparse(call.func).endswith("Record")
    return keyword.arg == "verdict" and not (record and copied)


def test_each_package_imports_only_what_it_may():
    assert forbidden_imports(ROOT) == []


def test_no_modules_import_each_other_in_a_circle():
    assert cycle(ROOT) == []


def test_each_folder_imports_only_from_those_before_it():
    assert wrong_order(ROOT) == []


def test_other_packages_come_in_by_a_folders_door():
    assert side_doors(ROOT) == []


@pytest.mark.parametrize(
    "source",
    [
        "from identify.fit.map_fit import fit_scan",
        "def f():\n    import identify.fit.map_fit",
        "from identify.fit import map_fit",
    ],
)
def test_an_import_past_the_door_is_found(source, tmp_path):
    for path, text in {
        "palpmap/a.py": source,
        "identify/fit/__init__.py": "from identify.fit.map_fit import fit_scan",
        "identify/fit/map_fit.py": "fit_scan = 1",
    }.items():
        file = tmp_path / path
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    (breach,) = side_doors(tmp_path)
    assert breach.startswith("palpmap.a, line ")
    assert breach.endswith("imports identify.fit.map_fit")


def test_every_folder_has_its_place_in_the_order():
    listed = {f"{package}/{f.replace('.', '/')}" for package in ORDER for f in ORDER[package]}
    there = {
        path.parent.relative_to(ROOT).as_posix()
        for package in OURS
        for path in (ROOT / package).rglob("*.py")
    }
    modules = {place for place in listed if (ROOT / f"{place}.py").is_file()}
    assert there - set(OURS) == listed - modules


def test_no_folder_is_crowded():
    assert crowded(ROOT) == []


def test_the_library_does_not_print():
    assert prints(ROOT) == []


def test_what_shows_a_result_neither_solves_nor_decides():
    assert decisions(ROOT) == []


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
    ("path", "source"),
    [
        ("fem/mesh/a.py", "from fem.solve import b"),
        ("identify/map/a.py", "def f():\n    from identify.select.b import c"),
        ("identify/effects/a.py", "import identify.effects.conformance.b"),
        ("palpmap/report/a.py", "if TYPE_CHECKING:\n    from palpmap.cli.b import c"),
        ("identify/select/a.py", "from identify.catalogue import CATALOGUE"),
        ("palpmap/report/a.py", "from palpmap import fit"),
    ],
)
def test_a_wrong_order_is_found(path, source, tmp_path):
    (tmp_path / "palpmap").mkdir()
    (tmp_path / "palpmap" / "__init__.py").touch()
    file = tmp_path / path
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(source)
    assert len(wrong_order(tmp_path)) == 1


def test_a_crowded_folder_is_found(tmp_path):
    for number in range(MOST_MODULES + 1):
        file = tmp_path / "fem" / "mesh" / f"m{number}.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.touch()
    assert crowded(tmp_path) == ["fem/mesh"]


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


@pytest.mark.parametrize(
    ("path", "source", "count"),
    [
        ("palpmap/result/a.py", "fit = fit_jointly(model, start)", 1),
        ("palpmap/report/a.py", "def f():\n    return model.linearise(u)", 1),
        ("palpmap/recording/a.py", "replace(explained, verdict='explained')", 1),
        ("palpmap/figures/a.py", "draw(explained.verdict)", 0),
        ("palpmap/result/a.py", "ExplainRecord(verdict=explained.verdict)", 0),
        ("palpmap/result/a.py", "ExplainRecord(verdict='explained')", 1),
        ("palpmap/result/a.py", "from identify.design.detection_limits import Limit, SHARE", 0),
        ("palpmap/report/a.py", "def f():\n    from identify.fit.joint_fit import try_fit", 1),
        ("palpmap/result/a.py", "import fem\nfrom identify.residual.statement import length", 0),
        ("palpmap/commands/a.py", "fit = fit_jointly(model, start)", 0),
    ],
)
def test_a_decision_while_showing_is_found(path, source, count, tmp_path):
    file = tmp_path / path
    file.parent.mkdir(parents=True)
    file.write_text(source)
    assert len(decisions(tmp_path)) == count
