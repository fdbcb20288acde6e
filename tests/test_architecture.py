"""Dependencies point one way; randomness, printing and heavy libraries stay where they belong."""

from __future__ import annotations

import ast
import importlib.util
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from rhs.api.contracts import KINDS

ROOT = Path(__file__).resolve().parents[1]
CORE = sorted((ROOT / "rhs").rglob("*.py"))
PLUGINS = sorted((ROOT / "plugins").glob("rhs_*/**/*.py"))
SKELETONS = sorted((ROOT / "rhs" / "cli" / "skeletons").glob("*.py"))  # copied by `rhs new`, imported by nobody
STRANGERS = [*sorted((ROOT / "tests" / "thirdparty").rglob("*.py")), *SKELETONS]

# The floors of the house, lowest first: a room imports from its own floor's rooms never, from lower floors only.
FLOORS = [
    {"base"},
    {"api"},
    {"config", "estimation", "plots", "worlds"},
    {"recording", "runfolder"},
    {"metrics", "testing"},
    {"reports"},
    {"patrol"},
    {"blame", "card", "sweeps"},
    {"face"},
    {"cli"},
]
FLOOR = {room: number for number, rooms in enumerate(FLOORS) for room in sorted(rooms)}
PUBLIC = {"api", "estimation", "plots", "worlds", "recording", "testing"}  # what plugins may import
COMMANDS = {"__main__", "table", "report", "evaluate", "convert", "planner_arena"}  # `python -m rhs.NAME`: two lines each
# Modules of less than SHORT lines that at most one other module imports, and why each is not a piece of that one.
SHORT = 60
SHALLOW = {
    "worlds.others.stage": "one program's form of building each",
    "worlds.other_maps": "what to say of forms that are not read, no business of who reads the others",
    "worlds.near_walls": "the middle of a hall left out of a survey: no business of who reads a file",
    "cli.blame": "a command", "cli.cache": "a command", "cli.check": "a command",
    "estimation.views.thumbnail_kernels": "compiled code, imported when needed",
    "estimation.views.thinning": "which places of many; the survey that asks knows nothing of distances between poses",
    "metrics.recording": "a provider of columns, found by its entry point",
    "reports.world_pictures": "draws; its importer only prints",
    "sweeps.server": "what the forking process imports, and no other",
    "testing.degradations": "one kind of plugin each", "testing.replans": "one kind of plugin each",
    "testing.slams": "one kind of plugin each",
    "patrol.ends": "where in a cell beams end: arithmetic of a grid, apart from what stands round the robot",
    "worlds.random.hall": "one family of buildings each",
}
HEAVY = {"cv2", "pybullet", "ompl", "numba", "scipy", "pandas", "matplotlib", "rosbags", "mcap", "kiss_icp", "gtsam",
         "small_gicp", "hydra", "omegaconf", "networkx", "imageio", "rerun"}


def room_of_any(path: Path) -> str:
    return room_of(path) if ROOT / "rhs" in path.parents else path.parent.name


def modules_used(tree: ast.AST, package: str) -> Iterator[str]:
    """Names of the modules a file of this package imports, relative ones written out."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            above = package.split(".")[:len(package.split(".")) - node.level + 1] if node.level else []
            base = ".".join([*above, *filter(None, [node.module])])
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)


def room_of(path: Path) -> str:
    inside = path.relative_to(ROOT / "rhs").parts
    if len(inside) > 1:
        return inside[0]
    return "cli" if path.stem in COMMANDS else "face"


def module_of(path: Path) -> str:
    parts = path.relative_to(ROOT if ROOT / "rhs" in path.parents else ROOT / "plugins").with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def tree_of(path: Path) -> ast.Module:
    return ast.parse(path.read_text("utf-8"))


@cache
def imports_of(path: Path, package: str) -> frozenset[str]:
    """`modules_used` by a file, kept: many rules ask, and trees are large."""
    return frozenset(modules_used(tree_of(path), package))


MODULES = {module_of(path): path for path in CORE}
FILES = {room: [path for path in [*CORE, *PLUGINS] if room_of_any(path) == room]  # of rooms and of plugins' folders
         for room in sorted({room_of_any(path) for path in [*CORE, *PLUGINS]})}
every_room = pytest.mark.parametrize("room", FILES)


@cache
def core_imports(path: Path) -> set[str]:
    """Modules of the core that a file imports, wherever in it, but for `build`: settings import the part they build."""
    package = module_of(path) if path.stem == "__init__" else module_of(path).rpartition(".")[0]
    tree = ast.parse(path.read_text("utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and node.name == "build":
            node.body = []
        if isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING":
            node.body = []
    return {name for name in modules_used(tree, package) if name in MODULES}


def rooms_used(path: Path) -> set[str]:
    own = {f"rhs.{node.name}" for node in ast.walk(tree_of(path)) if isinstance(node, ast.FunctionDef)}
    return {room_of(MODULES[name]) for name in core_imports(path) - own if name != "rhs"}


def test_every_room_has_a_floor():
    assert {room_of(path) for path in CORE} == set(FLOOR)


def test_the_guide_to_the_core_names_every_room():
    guide = (ROOT / "rhs" / "README.md").read_text("utf-8")
    assert {room for room in FLOOR if f"`{room}`" not in guide} == set()


@pytest.mark.parametrize("room", FLOOR)
def test_a_room_imports_from_lower_floors_only(room):
    upward = {(module_of(path), used) for path in FILES[room] for used in rooms_used(path) - {room}
              if FLOOR[used] >= FLOOR[room]}
    assert not upward, f"of floor {FLOOR[room]}: {sorted(upward)}"


def test_no_two_modules_import_each_other():
    graph = {name: core_imports(path) - {name, "rhs"} for name, path in MODULES.items() if path.stem != "__init__"}
    while graph:
        leaves = {name for name, used in graph.items() if not used & set(graph)}
        assert leaves, f"these import each other: {sorted(graph)}"
        graph = {name: used for name, used in graph.items() if name not in leaves}


@pytest.mark.parametrize("folder", sorted({path.parent for path in [*CORE, *PLUGINS]}), ids=lambda path: path.name)
def test_a_folder_holds_at_most_thirty_modules_of_at_most_four_hundred_lines(folder):
    modules = [path for path in folder.glob("*.py") if path.stem != "__init__"]
    assert len(modules) <= 30
    assert {path.name for path in modules if len(path.read_text("utf-8").splitlines()) > 400} == set()


def test_the_core_knows_no_plugin_by_name():
    assert not {(module_of(path), name) for path in CORE
                for name in imports_of(path, module_of(path).rpartition(".")[0]) if name.startswith("rhs_")}


def test_a_plugin_uses_only_what_any_stranger_may_use():
    for path in [*PLUGINS, *STRANGERS]:
        own = module_of(path).split(".")[0] if path in PLUGINS else path.parent.name
        package = module_of(path).rpartition(".")[0] if path in PLUGINS else own
        used = imports_of(path, package)
        others = {name for name in used if name.startswith("rhs_") and name.split(".")[0] != own}
        assert not others, f"{path} imports {others}"
        private = {room_of(MODULES[name]) for name in used if name in MODULES and name != "rhs"} - PUBLIC
        assert not private, f"{path} imports from {private}; plugins may import {sorted(PUBLIC)}"


def test_types_are_strict_in_the_public_rooms_and_checked_in_every_package():
    mypy = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["tool"]["mypy"]
    strict, = (rules for rules in mypy["overrides"] if rules.get("disallow_untyped_defs"))
    assert set(strict["module"]) == {"rhs", "rhs.cli.skeletons.*", *(f"rhs.{room}.*" for room in PUBLIC)}
    assert set(mypy["packages"]) == {"rhs", *(path.parent.name for path in (ROOT / "plugins").glob("rhs_*/__init__.py"))}


@every_room
def test_nobody_draws_from_a_generator_that_others_share(room):
    """numpy's and Python's global generators, and OpenCV's, are shared by everything in the process."""
    allowed = {"Generator", "default_rng", "SeedSequence", "PCG64", "BitGenerator"}
    watch = ("global_generators", "shared_state")  # which look whether others did
    looked_at = [path for path in FILES[room] if path.stem not in watch]
    for path, node in ((file, found) for file in looked_at for found in ast.walk(tree_of(file))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Attribute) and node.value.attr == "random":
            assert node.attr in allowed, f"{path}:{node.lineno}: np.random.{node.attr}"
        if isinstance(node, ast.Attribute) and path.stem != "retrieval":  # it seeds right before its own kd-trees
            assert node.attr != "setRNGSeed", f"{path}:{node.lineno}"
        if isinstance(node, ast.Import):
            assert "random" not in {alias.name for alias in node.names}, f"{path}:{node.lineno}: import random"
        if isinstance(node, ast.ImportFrom):
            assert node.module != "random", f"{path}:{node.lineno}"


@every_room
def test_nothing_but_a_command_line_ends_the_process(room):
    for path in FILES[room]:
        if path.stem == "__main__" or room == "cli":
            continue
        tree = tree_of(path)
        scripts = [node for node in tree.body if isinstance(node, ast.If) and "__main__" in ast.unparse(node.test)]
        inside = {id(inner) for node in scripts for inner in ast.walk(node)}
        for node in ast.walk(tree):
            if id(node) not in inside and isinstance(node, ast.Call):
                assert ast.unparse(node.func) not in ("sys.exit", "exit", "quit", "os._exit"), f"{path}:{node.lineno}"


def test_importing_every_settings_class_loads_nothing_heavy():
    code = ("import sys; from rhs.config import registry; from rhs.api.contracts import KINDS\n"
            "for kind in KINDS:\n    for name in registry.names(kind): registry.failure(kind, name)\n"
            f"    print(kind, sorted({HEAVY!r} & set(sys.modules)))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert [line.split(" ", 1)[1] for line in done.stdout.splitlines()] == ["[]"] * len(KINDS), done.stdout


def test_a_short_module_that_one_other_imports_has_a_reason():
    importers = {module_of(path): set() for path in CORE if path.stem != "__init__"}
    for path in CORE + PLUGINS:
        package = ".".join(path.relative_to(ROOT if path in CORE else ROOT / "plugins").parent.parts)
        for used in imports_of(path, package):
            if used in importers and path != ROOT / (used.replace(".", "/") + ".py"):
                importers[used].add(path)
    short = {name.removeprefix("rhs.") for name, who in importers.items() if len(who) <= 1 and is_short(name)}
    assert short == set(SHALLOW) | COMMANDS - {"__main__"}


def is_short(name: str) -> bool:
    path = ROOT / (name.replace(".", "/") + ".py")
    own = path.stem not in ("__init__", "__main__") and path not in SKELETONS
    return own and len(path.read_text(encoding="utf-8").splitlines()) < SHORT


@pytest.mark.parametrize("path", sorted((ROOT / "tests" / "benchmarks").glob("*.py")), ids=lambda path: path.stem)
def test_what_a_benchmark_imports_of_the_program_is_there(path):
    """They are run by hand, long after what they measure has moved."""
    wanted = [(node.module, name.name) for node in ast.walk(ast.parse(path.read_text())) if isinstance(node, ast.ImportFrom)
              for name in node.names if str(node.module).split(".")[0].startswith("rhs")]
    for module, name in wanted:
        assert hasattr(importlib.import_module(module), name) or importlib.util.find_spec(f"{module}.{name}"), (module, name)
