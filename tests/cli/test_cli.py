"""The command line as a stranger uses it: exit codes, one line of complaint, and nothing written when refused."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from installing import CHOICE, FAKES, environment, installed, interruptible

from rhs.base.commands import answered
from rhs.cli.main import main
from rhs.cli.one_run import Terminated
from rhs.cli.say import of_run
from rhs.cli.streams import warning_in_words
from rhs.config.compose import compose_config, config_hash, from_plain, read_values
from rhs.runfolder.row import canonical_hash, read_row

ONE_LINE = 260  # as tests/faults: what was found, and what to type


@pytest.fixture(autouse=True, scope="module")
def fakes():
    with installed(FAKES):
        yield


@pytest.fixture
def rhs(tmp_path, monkeypatch, capfd):
    """The command line in this process, standing in tmp_path: rhs(*words) -> exit code, stdout, stderr."""

    def run(*words: str) -> subprocess.CompletedProcess:
        monkeypatch.chdir(tmp_path)
        code = main(list(words))
        out, err = capfd.readouterr()
        return subprocess.CompletedProcess(words, code, out, err)

    return run


def start(folder: Path, *words: str, **more: str) -> subprocess.Popen:
    """The command line as a process of its own."""
    return subprocess.Popen([sys.executable, "-m", "rhs", *words], cwd=folder, env=environment(FAKES, **more),
                            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True,
                            preexec_fn=interruptible)


def with_part(kind: str, name: str) -> list[str]:
    return [word for word in CHOICE if not word.startswith(f"{kind}=")] + [f"{kind}={name}"]


def refused(done: subprocess.CompletedProcess, folder: Path) -> str:
    """Exit code 2, one line, no file: the complaint."""
    assert done.returncode == 2, (done.returncode, done.stderr)
    lines = done.stderr.splitlines()
    assert len(lines) == 1, done.stderr
    assert len(lines[0]) < ONE_LINE
    assert "Traceback" not in done.stderr
    assert list(folder.iterdir()) == [], "a refused run leaves nothing behind"
    return lines[0]


@pytest.fixture(scope="module")
def whole_run(tmp_path_factory) -> tuple[subprocess.CompletedProcess, Path]:
    """One run as a process of its own, and the folder it was started in."""
    folder = tmp_path_factory.mktemp("whole")
    process = start(folder, *CHOICE, "seed=4")
    out, err = process.communicate(timeout=180)
    return subprocess.CompletedProcess([], process.returncode, out, err), folder


def test_a_run_prints_its_figures_and_where_the_files_are(whole_run):
    done, folder = whole_run
    assert done.returncode == 0, done.stderr
    made = list((folder / "results" / "runs").iterdir())
    assert len(made) == 1 and made[0].name.endswith("_seed4")
    assert str(made[0]) in done.stdout
    row = json.loads((made[0] / "row.json").read_text())
    assert (row["status"], row["planner"], row["seed"], row["places_visited"]) == ("ok", "fake", 4, 2)
    assert f"places_visited{'':<14}2" in done.stdout
    assert "view" not in done.stderr, "no progress bar in a pipe"


def test_the_config_in_the_run_folder_gives_the_run_again(whole_run):
    made = next((whole_run[1] / "results" / "runs").iterdir())
    assert config_hash(from_plain(read_values(made))) == config_hash(compose_config([*CHOICE, "seed=4"]))


@pytest.mark.parametrize(("words", "says"), [
    (["sed=3"], "unknown key sed; did you mean seed?"),
    (["cach=false"], "unknown key cach; did you mean cache?"),
    (["source.path=walk.bag"], "unknown key source.path: source=fake has no such setting; type source=replay too"),
    (["planner=fak"], "did you mean fake?"),
    (["planner=broken"], "rhs_fakes.broken:Broken from rhs-fakes 0.1) cannot be imported: ModuleNotFoundError"),
    (["planner.samples=906970164"], "[1, 1000000]"),
    (["world=nowhere"], "nowhere"),
    (["hydra.ouput_subdir=x"], "did you mean hydra.output_subdir?"),
    (["--multirum"], "unknown option --multirum; did you mean --multirun?"),
    (["--config-dir", "absent"], "there is no such folder"),
    (["-m", "seed=0,-1"], "seed=-1 is outside the allowed range"),
    (["-m", "'seed=range(0)"], "cannot read"),
    (["-m", "seed=range(0)"], "no jobs"),
    (["-m", "output=a,b"], "a sweep has one folder"),
    (["-m", "seed=0,1", "--jobs", "-1"], "--jobs=-1 is outside"),
    (["-m", "seed=0,1", "--timeout", "nan"], "--timeout=nan is outside"),
    (["--resume", "absent"], "holds no sweep"),
])
def test_bad_words_are_refused(rhs, tmp_path, words, says):
    assert says in refused(rhs(*CHOICE, *words), tmp_path)


def test_debug_adds_the_traceback(rhs):
    done = rhs(*CHOICE, "sed=3", "--debug")
    assert done.returncode == 2
    assert "Traceback" in done.stderr
    assert done.stderr.splitlines()[-1].startswith("rhs: unknown key sed")


def test_a_folder_with_a_finished_run_is_kept(rhs, whole_run, tmp_path):
    made = next((whole_run[1] / "results" / "runs").iterdir())
    before = {path.name: path.read_bytes() for path in made.iterdir() if path.is_file()}
    done = rhs(*CHOICE, f"output={made}")
    assert "already holds a finished run; take another folder or type overwrite=true" in refused(done, tmp_path)
    assert {path.name: path.read_bytes() for path in made.iterdir() if path.is_file()} == before


def test_a_place_that_cannot_be_written_is_refused(rhs, tmp_path):
    (tmp_path / "a file").write_text("keep me")
    for output in ("a file", "a file/run", "/proc/nothing", f"{'x' * 300}"):
        done = rhs(*CHOICE, f"output='{output}'")
        assert done.returncode == 2, output
        assert "cannot write into" in done.stderr or "a file" in done.stderr
        assert len(done.stderr.splitlines()) == 1
        assert [path.name for path in tmp_path.iterdir()] == ["a file"]
    assert (tmp_path / "a file").read_text() == "keep me"


@pytest.mark.parametrize("name", ["mit Leerzeichen und Ümläuten", "a=b,c", "x" * 200])
def test_odd_names_of_folders_work(rhs, tmp_path, name):
    done = rhs(*CHOICE, f"output='{name}'", "source.views=2")
    assert done.returncode == 0, done.stderr
    assert (tmp_path / name / "row.json").exists()


def test_two_runs_in_one_folder_at_once_do_not_mix(rhs, tmp_path):
    first = start(tmp_path, *CHOICE, "output=same", "source.delay_s=0.3")
    wait_for(tmp_path / "same" / "config.yaml")
    second = rhs(*CHOICE, "output=same")
    assert second.returncode == 2
    assert "is in use by another run" in second.stderr
    assert first.wait(120) == 0


def test_two_runs_in_one_second_get_two_folders(tmp_path):
    both = [start(tmp_path, *CHOICE, "source.views=2") for _ in range(2)]
    assert [process.wait(120) for process in both] == [0, 0]
    assert len(list((tmp_path / "results" / "runs").glob("*/row.json"))) == 2


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupted_run_keeps_what_it_has(tmp_path, number, code):
    process = start(tmp_path, *CHOICE, "output=run", "source.views=500", "source.delay_s=0.05")
    wait_for_lines(tmp_path / "run", "steps.jsonl*", 3)
    process.send_signal(number)
    _, err = process.communicate(timeout=60)
    assert process.returncode == code, err
    row = json.loads((tmp_path / "run" / "row.json").read_text())
    assert row["status"] == "interrupted"
    assert len((tmp_path / "run" / "steps.csv").read_text().splitlines()) >= 3
    assert not list((tmp_path / "run").glob("*.tmp-*"))


@pytest.mark.parametrize(("how", "reason"), [
    ("raise", "ValueError at step 2: the odometry of this test fails on purpose"),
    ("exit", "SystemExit at step 2: 3"),
    ("none_result", "odometry=faulty (rhs-fakes 0.1): what it returned is of type NoneType; expected a Motion"),
    ("nan_pose", "odometry=faulty (rhs-fakes 0.1): previous_from_body is not finite"),
    ("shape", "odometry=faulty (rhs-fakes 0.1): covariance is of shape (3, 3)"),
    ("mutate", "read-only"),
])
def test_a_part_that_fails_makes_a_failed_row_with_what_there_was(rhs, tmp_path, how, reason):
    done = rhs(*with_part("odometry", "faulty"), f"odometry.how={how}", "output=run")
    assert done.returncode == 1, done.stderr
    row = json.loads((tmp_path / "run" / "row.json").read_text())
    assert row["status"] == "failed"
    assert reason in row["reason"]
    assert "Traceback" not in done.stderr
    assert len((tmp_path / "run" / "steps.csv").read_text().splitlines()) == 3, "header and the steps before"


def test_neither_watching_nor_the_surroundings_change_the_numbers(whole_run, tmp_path):
    base = next((whole_run[1] / "results" / "runs").iterdir())
    process = start(tmp_path, *CHOICE, "seed=4", "recording=off", "output=elsewhere/run", PYTHONHASHSEED="1",
                    TZ="Pacific/Kiritimati", LC_ALL="C", OMP_NUM_THREADS="2", HOME="/proc/no home")
    assert process.wait(180) == 0, process.communicate()[1]
    other = tmp_path / "elsewhere" / "run"
    assert canonical_hash(read_row(base / "row.json")) == canonical_hash(read_row(other / "row.json"))


def test_the_seed_matters_and_only_the_seed(rhs, tmp_path):
    ends = []
    for seed in (0, 1):
        assert rhs(*CHOICE, f"seed={seed}", f"output=run{seed}").returncode == 0
        ends.append(read_row(tmp_path / f"run{seed}" / "row.json")["end_error_m"])
    assert ends[0] != ends[1]


def test_a_part_that_reseeds_everything_changes_nothing(rhs, tmp_path):
    ends = []
    for how in ("none", "reseed"):
        done = rhs(*with_part("odometry", "faulty"), f"odometry.how={how}", f"output={how}")
        assert done.returncode == 0, done.stderr
        row = read_row(tmp_path / how / "row.json")
        ends.append({k: row[k] for k in ("end_error_m", "ate_rmse_m", "path_length_m", "places_visited")})
    assert ends[0] == ends[1]


def test_version_and_configuration_are_printed_without_running(rhs, tmp_path):
    assert rhs("--version").stdout.startswith("rhs ")
    done = rhs(*CHOICE, "planner.samples=7", "--cfg")
    assert "samples: 7" in done.stdout
    assert list(tmp_path.iterdir()) == []


def wait_for(path: Path, seconds: float = 60) -> None:
    end = time.monotonic() + seconds
    while not path.exists():
        assert time.monotonic() < end, f"{path} did not appear"
        time.sleep(0.02)


def wait_for_lines(folder: Path, pattern: str, lines: int, seconds: float = 60) -> None:
    end = time.monotonic() + seconds
    while not any(len(path.read_text().splitlines()) >= lines for path in folder.glob(pattern)):
        assert time.monotonic() < end, f"{folder}/{pattern} did not grow"
        time.sleep(0.05)


def test_motions_that_the_wheels_had_to_replace_are_told(tmp_path):
    assert "gated_share" in of_run({"gated_share": 0.96}, tmp_path) and not of_run({"gated_share": 0.0}, tmp_path)


def test_a_warning_of_somebodys_code_says_where_it_was_raised():
    told = warning_in_words("invalid value encountered in cast", RuntimeWarning, "/home/x/strange/parts.py", 37)
    assert told == "rhs: warning in strange/parts.py:37: RuntimeWarning: invalid value encountered in cast"
    assert warning_in_words("a is now b", FutureWarning, "/x.py", 1) == "rhs: a is now b"


def test_what_was_to_be_done_at_the_end_is_done_and_all_that_was_written_is_there(tmp_path):
    """Also what stands in a file that nobody closed."""
    code = ("import atexit, sys; atexit.register(print, 'done'); file = open(sys.argv[1], 'w'); file.write('a'); "
            "sys.argv[1:] = ['--version']\nfrom rhs.cli.main import entry; sys.exit(entry())")
    ended = subprocess.run([sys.executable, "-c", code, str(tmp_path / "open.txt")], capture_output=True, text=True)
    assert ended.returncode == 0 and ended.stdout.splitlines()[1:] == ["done"]
    assert (tmp_path / "open.txt").read_text() == "a"


def test_ctrl_c_while_the_program_is_loaded_ends_it_without_a_traceback():
    code = ("import signal, sys; signal.signal(signal.SIGINT, signal.default_int_handler); import rhs.__main__; "
            "sys.exit(signal.getsignal(signal.SIGINT) is not signal.SIG_DFL)")
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0


def test_a_command_that_is_ended_by_sigterm_says_so_by_its_exit_code(capsys):
    def ended():
        raise Terminated

    assert answered(ended) == 143 and capsys.readouterr().err == "rhs: interrupted; what was finished is kept\n"


def test_who_is_started_without_streams_hands_on_some():
    """Processes of a sweep have no files in their places."""
    code = ("import os; [os.close(k) for k in range(3)]; from rhs.cli.main import open_streams; open_streams(); "
            "os._exit(not all(map(os.get_inheritable, range(3))))")
    assert subprocess.run([sys.executable, "-c", code]).returncode == 0
