"""Faults of the surroundings, of plugins and of files: what the program promises when they happen."""

from __future__ import annotations

import ast
import json
import os
import resource
import subprocess
import sys
from pathlib import Path

import pytest
from installing import CHOICE, FAKES, environment, installed

import rhs
from rhs.cli.main import THREADS, main
from rhs.runfolder.row import canonical_hash, read_row

ROOT = Path(__file__).resolve().parents[2]
SOURCES = [*sorted((ROOT / "rhs").glob("*.py")), *sorted((ROOT / "plugins").glob("*/*.py"))]


@pytest.fixture(autouse=True, scope="module")
def fakes():
    with installed(FAKES):
        yield


def child(folder: Path, *words: str, limit=None, **more: str) -> subprocess.CompletedProcess:
    """The command line in a process with limits of its own."""
    return subprocess.run([sys.executable, "-m", "rhs", *words], cwd=folder, env=environment(FAKES, **more),
                          capture_output=True, text=True, timeout=180, preexec_fn=limit)


# --- security --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: path.stem)
def test_data_is_never_code(path):
    """No pickle, no eval, no unsafe YAML, no shell: files are read as values only."""
    tree = ast.parse(path.read_text("utf-8"))
    for node in ast.walk(tree):
        if isinstance(node, (ast.Import, ast.ImportFrom)):
            names = {alias.name for alias in node.names} | {getattr(node, "module", "")}
            assert not names & {"pickle", "shelve", "marshal", "dill", "cloudpickle"}, f"{path}:{node.lineno}"
        if not isinstance(node, ast.Call):
            continue
        name, words = ast.unparse(node.func), {word.arg: ast.unparse(word.value) for word in node.keywords}
        assert name not in ("eval", "exec", "os.system", "yaml.unsafe_load", "yaml.full_load", "torch.load"), node.lineno
        assert words.get("shell", "False") == "False", f"{path}:{node.lineno}"
        assert words.get("allow_pickle", "False") == "False", f"{path}:{node.lineno}"
        if name in ("np.load", "numpy.load"):
            assert "allow_pickle" in words, f"{path}:{node.lineno}: write allow_pickle=False"


def test_a_world_file_cannot_run_code(tmp_path, monkeypatch, capfd):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "evil.yaml").write_text("name: !!python/object/apply:os.system ['touch canary']\n")
    assert main([*CHOICE, "world=evil.yaml"]) == 2
    assert "evil.yaml:1" in capfd.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["evil.yaml"]


@pytest.mark.parametrize("name", ["../../x", "/tmp/x", "a/b", "..", "a\\nb"])
def test_the_name_of_a_place_cannot_lead_out_of_the_run_folder(tmp_path, monkeypatch, capfd, name):
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "worlds" / "square_small.yaml").read_text()
    (tmp_path / "w.yaml").write_text(text.replace("first_corridor:", f'"{name}":', 1))
    assert main([*CHOICE, "world=w.yaml"]) == 2
    assert "w.yaml:" in capfd.readouterr().err


def test_the_environment_is_not_written_down(tmp_path):
    done = child(tmp_path, *CHOICE, "source.views=2", "output=run", MY_SECRET_TOKEN="s3cr3t-value")
    assert done.returncode == 0, done.stderr
    for path in (tmp_path / "run").rglob("*"):
        assert path.is_dir() or b"s3cr3t-value" not in path.read_bytes(), path


# --- plugins ---------------------------------------------------------------------------------------------------------


def test_a_part_cannot_change_what_others_see(tmp_path):
    """A localiser that scribbles over the map, the views and the observations changes no number."""
    others = [word for word in CHOICE if not word.startswith("localiser=")]
    rows = []
    for name in ("fake", "vandal"):
        row = rhs.run([*others, f"localiser={name}", f"output='{tmp_path / name}'"], quiet=True)
        rows.append({key: row[key] for key in ("status", "end_error_m", "path_length_m", "places_visited", "ate_rmse_m")})
    assert rows[0] == rows[1]


def test_many_runs_in_one_process_leak_nothing(tmp_path):
    """Open files and memory stay where they are (a notebook, a long sweep in one process)."""
    open_files, memory_mb = [], []
    for number in range(18):
        rhs.run([*CHOICE, "source.views=2", f"output='{tmp_path / str(number)}'"], quiet=True)
        open_files.append(len(os.listdir("/proc/self/fd")))
        memory_mb.append(int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**20)
    assert open_files[-1] == open_files[1]
    assert memory_mb[-1] < 1.05 * memory_mb[11], "once the libraries are loaded, runs leave nothing behind"


def test_a_run_does_not_depend_on_the_run_before_it(tmp_path):
    """History independence: B alone, and B after A in the same process, are one row."""
    rhs.run([*CHOICE, "seed=5", f"output='{tmp_path / 'a'}'"], quiet=True)
    rhs.run([*CHOICE, "seed=6", f"output='{tmp_path / 'b'}'"], quiet=True)
    done = child(tmp_path, *CHOICE, "seed=6", "output=alone")
    assert done.returncode == 0, done.stderr
    assert canonical_hash(read_row(tmp_path / "b" / "row.json")) == canonical_hash(read_row(tmp_path / "alone" / "row.json"))


# --- surroundings ----------------------------------------------------------------------------------------------------


def test_sums_are_made_on_one_thread_whatever_the_environment_says(tmp_path):
    code = f"import rhs.__main__, os; print([os.environ[name] for name in {THREADS!r}])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True,
                          env=environment(OMP_NUM_THREADS="8", OPENBLAS_NUM_THREADS="8"))
    assert done.stdout.strip() == str(["1"] * len(THREADS))


def test_a_full_disk_ends_the_run_with_one_line_and_no_half_file(tmp_path):
    """Files may have 20 kB here; the recording and the map need more."""
    def limit() -> None:
        import signal

        signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
        resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))

    done = child(tmp_path, *CHOICE, "source.views=60", "output=run", limit=limit)
    assert done.returncode == 1, (done.returncode, done.stderr)
    assert len(done.stderr.splitlines()) == 1
    assert "cannot write" in done.stderr or "File too large" in done.stderr
    if (tmp_path / "run" / "row.json").exists():
        assert read_row(tmp_path / "run" / "row.json")["status"] == "failed"
    for path in (tmp_path / "run").glob("*.json"):
        json.loads(path.read_text())


def test_few_open_files_are_enough(tmp_path):
    done = child(tmp_path, *CHOICE, "source.views=4", "output=run",
                 limit=lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (64, 64)))
    assert done.returncode == 0, done.stderr


def test_little_memory_is_enough_or_refused_in_one_line(tmp_path):
    limit = 3 << 30
    done = child(tmp_path, *CHOICE, "source.views=4", "output=run",
                 limit=lambda: resource.setrlimit(resource.RLIMIT_AS, (limit, limit)))
    assert done.returncode in (0, 1)
    assert done.returncode == 0 or len(done.stderr.splitlines()) == 1


def test_a_closed_pipe_is_no_accident(tmp_path):
    done = subprocess.run(f"{sys.executable} -m rhs --help | head -1", shell=True, cwd=tmp_path, capture_output=True,
                          text=True, env=environment(FAKES), timeout=60)
    assert done.returncode == 0
    assert "Traceback" not in done.stderr
    assert "Broken" not in done.stderr
