"""The program that the package runs behaves as the executable: exit codes, signals, and starting itself again."""

import json
import os
import shlex
import signal
import subprocess
import sys
import threading

import nelu3d
import pytest

EXPERIMENT = """
title = "Depth of a ball"
source = "Nowhere"

[rigs.small]
preset = "demo"

[rigs.small.set]
supersampling = 2

[[rigs.small.set.scenes]]
name = "ball"
objects = [{ position_mm = [0.0, 0.0, 700.0], shape = { kind = "sphere", radius_mm = 50.0 } }]

[rigs.small.set.sweep]
positions = 8

[[cases]]
label = "ball"
rig = "small"
scene = "ball"

[[methods]]
label = "fast"
run = "reconstruct --effort quick"

[[columns]]
label = "MAE, mm"
value = "result.metrics.whole.depth_mm.mae"
main = true
"""


@pytest.fixture(params=["command", "module"])
def started(request, program):
    """The words that start the program, in both ways."""
    return [program.path] if request.param == "command" else [sys.executable, "-m", "nelu3d"]


def finish(words, *args, **how):
    """Runs the program to its end."""
    return subprocess.run([*words, *map(str, args)], capture_output=True, text=True, **how)


def test_usage_and_exit_codes(started, tmp_path):
    version = finish(started, "--version")
    assert (version.returncode, version.stdout) == (0, f"nelu3d {nelu3d.__version__}\n"), version
    usage = finish(started, "--help")
    assert usage.returncode == 0 and "Usage: nelu3d [OPTIONS] <COMMAND>" in usage.stdout, usage
    wrong = finish(started, "reconstruct", "--no-such-option")
    assert wrong.returncode == 2 and "Usage: nelu3d reconstruct" in wrong.stderr, wrong
    failed = finish(started, "calibrate", tmp_path)
    assert failed.returncode == 1 and failed.stderr.startswith("nelu3d: ") and "is no rig" in failed.stderr, failed
    bad = finish(started, "check", tmp_path, "--json")
    assert bad.returncode == 1 and json.loads(bad.stdout)["ok"] is False, bad


def test_the_program_starts_without_numpy():
    code = "import sys, nelu3d.__main__ as program; sys.argv[1:] = ['devices', '--json']; done = program.main(); "
    code += "print(sorted({'numpy'} & set(sys.modules)), file=sys.stderr)"
    done = finish([sys.executable, "-c", code])
    assert done.returncode == 0 and json.loads(done.stdout) and done.stderr == "[]\n", done


@pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")
@pytest.mark.parametrize("number, code", [("SIGINT", 1), ("SIGTERM", 143)])
def test_signals_end_the_program_as_they_end_the_executable(started, rig, field, tmp_path, number, code):
    field.save(tmp_path / "f.safetensors")
    paper = ["--recipe", "paper", "--steps", "100000", "--device", "cpu", "--field", tmp_path / "f.safetensors"]
    process = subprocess.Popen(
        [*started, "reconstruct", rig.root, "ball", *paper, "-o", tmp_path / "ball"], stderr=subprocess.PIPE, text=True
    )
    # A program that does not stop is to fail the test, not to hang it.
    watchdog = threading.Timer(120, process.kill)
    watchdog.start()
    # It listens for signals before its first stage ends.
    first = process.stderr.readline()
    process.send_signal(getattr(signal, number))
    said = process.stderr.read()
    watchdog.cancel()
    assert process.wait() == code, first + said
    assert "stopping (" in said and "Traceback" not in said, first + said
    assert said.endswith("nelu3d: stopped; nothing half written was left behind\n"), first + said
    assert [path.name for path in tmp_path.iterdir()] == ["f.safetensors"]


def test_experiments_start_the_program_again(started, tmp_path):
    (tmp_path / "ball.toml").write_text(EXPERIMENT)
    run = ["experiment", tmp_path / "ball.toml", "-o", tmp_path / "out", "--json", "--quiet"]
    done = finish(started, *run)
    assert done.returncode == 0, done.stderr
    answer = json.loads(done.stdout)
    # Simulated, calibrated, reconstructed.
    assert answer["ran"] == 3 and answer["reused"] == 0, answer
    again = json.loads(finish(started, *run).stdout)
    assert again["ran"] == 0 and again["reused"] == 3 and again["numbers"] == answer["numbers"], again


@pytest.mark.skipif(os.name != "posix", reason="scripts of a POSIX shell")
def test_jobs_of_a_cluster_start_the_program_again(started, rig, field, tmp_path):
    field.save(tmp_path / "f.safetensors")
    script, out = tmp_path / "job.sh", tmp_path / "out"
    more = ["--field", tmp_path / "f.safetensors", "-o", out, "--keyframe", "2", "--slurm", script]
    done = finish(started, "sequence", rig.root, "hand", *more)
    assert done.returncode == 0, done.stderr
    command = shlex.split(script.read_text().splitlines()[-1])
    assert command[2:5] == ["-m", "nelu3d", "sequence"] and os.path.samefile(command[1], sys.executable), command
    for task in ["1", "2"]:
        done = subprocess.run(["sh", script], env={**os.environ, "SLURM_ARRAY_TASK_ID": task}, capture_output=True)
        assert done.returncode == 0, done.stderr
    assert all((out / f"{i:03}" / "depth.npy").exists() for i in range(4)), list(out.iterdir())
