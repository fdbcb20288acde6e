"""What the program promises beside the faults of tests/faults: data is never code, no run depends on the one before it."""

from __future__ import annotations

import ast
import json
import subprocess
import sys
from pathlib import Path

import pytest
from installing import CHOICE, FAKES, environment, installed

import rhs
from rhs.base.processes import BLAS, NUMPY, THREADS
from rhs.base.system import vector_units
from rhs.runfolder.row import canonical_hash, read_row

ROOT = Path(__file__).resolve().parents[2]
OWN_MEMORY = ("rhs/estimation/kept_views.py",  # pickles views into a file without a name, which only this process can open
              "rhs/sweeps/survey_cache.py",  # reads back its own files, of this user and nobody else's to write
              "rhs/testing/odometry.py")  # reads what it has just made
SOURCES = [*sorted((ROOT / "rhs").rglob("*.py")), *sorted((ROOT / "plugins").rglob("*.py"))]


@pytest.fixture(autouse=True, scope="module")
def fakes():
    with installed(FAKES):
        yield


def child(folder: Path, *words: str, limit=None, **more: str) -> subprocess.CompletedProcess:
    """The command line in a process with limits of its own."""
    return subprocess.run([sys.executable, "-m", "rhs", *words], cwd=folder, env=environment(FAKES, **more),
                          capture_output=True, text=True, timeout=180, preexec_fn=limit)


# --- security --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("folder", sorted({path.parent for path in SOURCES}), ids=lambda path: str(path.relative_to(ROOT)))
def test_data_is_never_code(folder):
    """No pickle, no eval, no unsafe YAML, no shell: files are read as values only."""
    for path in folder.glob("*.py"):
        kept = {"pickle"} if str(path.relative_to(ROOT)) in OWN_MEMORY else set()
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, (ast.Import, ast.ImportFrom)):
                names = {alias.name for alias in node.names} | {getattr(node, "module", "")}
                assert not names & {"pickle", "shelve", "marshal", "dill", "cloudpickle"} - kept, f"{path}:{node.lineno}"
            if not isinstance(node, ast.Call):
                continue
            name, words = ast.unparse(node.func), {word.arg: ast.unparse(word.value) for word in node.keywords}
            unsafe = ("eval", "exec", "os.system", "yaml.unsafe_load", "yaml.full_load", "torch.load")
            assert name not in unsafe, f"{path}:{node.lineno}"
            assert words.get("shell", "False") == "False", f"{path}:{node.lineno}"
            assert words.get("allow_pickle", "False") == "False", f"{path}:{node.lineno}"
            if name in ("np.load", "numpy.load"):
                assert "allow_pickle" in words, f"{path}:{node.lineno}: write allow_pickle=False"


# --- plugins ---------------------------------------------------------------------------------------------------------


MANY_RUNS = f"""
import gc, json, os, resource, rhs
from pathlib import Path
open_files, memory_mb = [], []
for number in range(18):
    rhs.run([*{CHOICE!r}, "source.views=2", f"output=r{{number}}"], quiet=True)
    gc.collect()  # figures and configurations hold themselves until then
    open_files.append(len(os.listdir("/proc/self/fd")))
    memory_mb.append(int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20)
print(json.dumps([open_files, memory_mb]))
"""


def test_many_runs_in_one_process_leak_nothing(tmp_path):
    """Open files and memory stay where they are (a notebook, a long sweep in one process)."""
    done = subprocess.run([sys.executable, "-c", MANY_RUNS], cwd=tmp_path, env=environment(FAKES), check=True, text=True,
                          stdout=subprocess.PIPE)
    open_files, memory_mb = json.loads(done.stdout.splitlines()[-1])
    assert len(memory_mb) == 18 and open_files[-1] == open_files[1]
    assert memory_mb[-1] < 1.05 * memory_mb[11], "once the libraries are loaded, runs leave nothing behind"


def test_a_run_does_not_depend_on_the_run_before_it(tmp_path):
    """History independence: B alone, and B after A in the same process, are one row."""
    rhs.run([*CHOICE, "seed=5", f"output='{tmp_path / 'a'}'"], quiet=True)
    rhs.run([*CHOICE, "seed=6", f"output='{tmp_path / 'b'}'"], quiet=True)
    done = child(tmp_path, *CHOICE, "seed=6", "output=alone")
    assert done.returncode == 0, done.stderr
    assert canonical_hash(read_row(tmp_path / "b" / "row.json")) == canonical_hash(read_row(tmp_path / "alone" / "row.json"))


# --- surroundings ----------------------------------------------------------------------------------------------------


def test_sums_are_made_on_one_thread_and_as_everywhere_whatever_the_environment_says(tmp_path):
    """A row is the same on Intel's and AMD's processors: with the kernels that each would choose, patrols differed."""
    code = "import rhs.__main__, os, json; print(json.dumps(dict(os.environ)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                          env=environment(OMP_NUM_THREADS="8", OPENBLAS_NUM_THREADS="8", OPENBLAS_CORETYPE="Prescott"))
    told, units = json.loads(done.stdout), vector_units()
    assert {name: told[name] for name in THREADS} == dict.fromkeys(THREADS, "1")
    assert told[BLAS] == ("Haswell" if "avx2" in units else "Prescott")
    assert ("X86_V4" in told.get(NUMPY, "")) == ("avx512f" in units)


def test_a_terminal_that_lacks_a_letter_is_no_accident(tmp_path):
    done = child(tmp_path, *CHOICE, "output='with \u00fc'", PYTHONIOENCODING="ascii")
    assert done.returncode == 0 and "with ?" in done.stdout and (tmp_path / "with \u00fc" / "row.json").exists(), done.stderr


def test_a_closed_pipe_is_no_accident(tmp_path):
    done = subprocess.run(f"{sys.executable} -m rhs help settings | head -1", shell=True, cwd=tmp_path, capture_output=True,
                          text=True, env=environment(FAKES), timeout=60)
    assert done.returncode == 0
    assert "Traceback" not in done.stderr
    assert "Broken" not in done.stderr
