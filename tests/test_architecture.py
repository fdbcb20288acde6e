"""Dependencies point one way; randomness, printing and heavy libraries stay where they belong."""

from __future__ import annotations

import ast
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rhs.contracts import KINDS

ROOT = Path(__file__).resolve().parents[1]
CORE = sorted((ROOT / "rhs").glob("*.py"))
PLUGINS = sorted((ROOT / "plugins").glob("rhs_*/**/*.py"))

LEVELS = [
    "errors sealing distortion geometry jit allocator paths provenance mcap_records meanings",
    "files grid records filtering settings strict_yaml yamlfile mcap_scan nearest rigid_kernels posegraph particles tubes"
    " unroll_settings gate_settings",
    "floorplan world_checks world vision rays rigid belief trajectory accuracy rowfile folders retrieval hypotheses"
    " consistency structure memory glance_kernels likelihood heaps scanmatch walllines mosaic bending unrolling bend_finder"
    " unroll_folder",
    "contracts mission control obstacles sighting support glances continuity loops scanloops places place_files place_trial"
    " ros playback recording maps judge judge_kernels recover tape"
    " live movingai arena plan_files",
    "patrol survey sentinel search kidnap steps progress knowing metrics map_metrics testing_room"
    " testing_estimators testing_planners testing_sources testing",
    "varied evaluate compare drawing page summary table report charts film knowing_pictures registry parts"
    " overrides hydra_sources hydra_glue compose help_text convert convert_tum planning_metrics"
    " planning_pictures planning_task planning_table planner_arena places_task"
    " unroll_task unroll_truth unroll_pictures gating task_row notebook",
    "experiment told",
    "launcher sweep __init__",
    "__main__",
]
LEVEL = {name: number for number, names in enumerate(LEVELS) for name in names.split()}
HEAVY = {"cv2", "pybullet", "ompl", "numba", "scipy", "pandas", "matplotlib", "rosbags", "mcap", "kiss_icp", "gtsam",
         "small_gicp", "hydra", "omegaconf", "networkx", "imageio", "rerun"}


def modules_used(tree: ast.AST, package: str = "rhs") -> Iterator[str]:
    """Names of the modules a file imports; `from .x import y` counts as rhs.x (or rhs_name.x in a plugin)."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            base = ".".join(filter(None, [package if node.level else "", node.module]))
            yield base
            yield from (f"{base}.{alias.name}" for alias in node.names)


def core_imports(path: Path, package: str = "rhs") -> set[str]:
    names = {path.stem for path in CORE}
    used = (name.split(".") for name in modules_used(ast.parse(path.read_text("utf-8")), package))
    return {parts[1] for parts in used if parts[0] == "rhs" and len(parts) > 1 and parts[1] in names}


def test_every_module_of_the_core_has_a_level():
    assert {path.stem for path in CORE} - set(LEVEL) == set(), "give it a level in LEVELS"


def test_the_guide_to_the_core_names_every_module():
    guide = (ROOT / "rhs" / "README.md").read_text("utf-8")
    missing = {path.stem for path in CORE if f"`{path.stem}`" not in guide}
    assert {name for name in missing if not name.startswith(("__", "testing_"))} == set()


@pytest.mark.parametrize("path", CORE, ids=lambda path: path.stem)
def test_a_module_imports_nothing_above_it(path):
    own = LEVEL.get(path.stem, 0)
    upward = {name for name in core_imports(path) if LEVEL.get(name, own) > own}
    assert not upward, f"{path.stem} (level {own}) imports {upward}"


def test_no_two_modules_import_each_other():
    graph = {path.stem: core_imports(path) - {path.stem} for path in CORE}
    while graph:
        leaves = {name for name, used in graph.items() if not used & set(graph)}
        assert leaves, f"these import each other: {sorted(graph)}"
        graph = {name: used for name, used in graph.items() if name not in leaves}


@pytest.mark.parametrize("path", CORE, ids=lambda path: path.stem)
def test_the_core_knows_no_plugin_by_name(path):
    used = set(modules_used(ast.parse(path.read_text("utf-8"))))
    assert not {name for name in used if name.startswith("rhs_")}


@pytest.mark.parametrize("path", PLUGINS, ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_a_plugin_uses_only_what_any_stranger_may_use(path):
    tree, own = ast.parse(path.read_text("utf-8")), path.relative_to(ROOT / "plugins").parts[0]
    others = {name for name in modules_used(tree, own) if name.startswith("rhs_") and name.split(".")[0] != own}
    assert not others, f"{own} imports {others}"
    high = {name for name in core_imports(path, own) if LEVEL.get(name, 0) > 3}
    assert not high, f"{path} imports {high}, which lie above the contracts"


@pytest.mark.parametrize("path", [*CORE, *PLUGINS], ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_nobody_draws_from_a_generator_that_others_share(path):
    """numpy's and Python's global generators, and OpenCV's, are shared by everything in the process."""
    allowed = {"Generator", "default_rng", "SeedSequence", "PCG64", "BitGenerator"}
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Attribute) and node.value.attr == "random":
            assert node.attr in allowed, f"{path}:{node.lineno}: np.random.{node.attr}"
        if isinstance(node, ast.Attribute) and path.stem != "retrieval":  # it seeds right before its own kd-trees
            assert node.attr != "setRNGSeed", f"{path}:{node.lineno}"
        if isinstance(node, ast.Import):
            assert "random" not in {alias.name for alias in node.names}, f"{path}:{node.lineno}: import random"
        if isinstance(node, ast.ImportFrom):
            assert node.module != "random", f"{path}:{node.lineno}"


@pytest.mark.parametrize("path", [*CORE, *PLUGINS], ids=lambda path: f"{path.parent.name}/{path.stem}")
def test_nothing_but_a_command_line_ends_the_process(path):
    if path.stem == "__main__":
        return
    tree = ast.parse(path.read_text("utf-8"))
    scripts = [node for node in tree.body if isinstance(node, ast.If) and "__main__" in ast.unparse(node.test)]
    inside = {id(inner) for node in scripts for inner in ast.walk(node)}
    for node in ast.walk(tree):
        if id(node) not in inside and isinstance(node, ast.Call):
            assert ast.unparse(node.func) not in ("sys.exit", "exit", "quit", "os._exit"), f"{path}:{node.lineno}"


def test_importing_every_settings_class_loads_nothing_heavy():
    code = ("import sys; from rhs import registry; from rhs.contracts import KINDS\n"
            "for kind in KINDS:\n    for name in registry.names(kind): registry.failure(kind, name)\n"
            f"    print(kind, sorted({HEAVY!r} & set(sys.modules)))")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert [line.split(" ", 1)[1] for line in done.stdout.splitlines()] == ["[]"] * len(KINDS), done.stdout
