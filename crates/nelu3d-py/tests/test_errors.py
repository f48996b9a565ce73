"""Every error is an exception with one sentence; Ctrl-C stops cleanly; nothing is silent."""

import os
import re
import signal
import subprocess
import sys
import textwrap
import threading
import time

import nelu3d
import numpy as np
import pytest


def test_a_folder_that_is_no_rig(program, tmp_path):
    with pytest.raises(nelu3d.Error, match="is no rig: it has no rig.toml") as caught:
        nelu3d.Rig.open(tmp_path)
    said = subprocess.run([program.path, "check", tmp_path], capture_output=True, text=True)
    assert str(caught.value) in said.stderr + said.stdout, "the program says the same"


@pytest.mark.parametrize(
    "call, sentence",
    [
        (lambda rig: nelu3d.reconstruct(rig, "cup"), r"no scene `cup`; the rig has: ball"),
        (lambda rig: nelu3d.reconstruct(rig, "ball"), r"there is no color field; make one with nelu3d.calibrate"),
        (lambda rig: nelu3d.reconstruct(rig, "ball", 3), r"field: give a nelu3d.ColorField"),
        (lambda rig: nelu3d.calibrate(rig, set="three"), r"no pattern set `three`; it has: two, other, gray"),
        (lambda rig: nelu3d.calibrate(rig, hold_outt=3), r"unknown field `hold_outt`.*correct the argument"),
        (lambda rig: nelu3d.calibrate(rig, device="tpu"), r"device: \"tpu\""),
        (lambda rig: nelu3d.decode(rig, "ball", "magic"), r"unknown variant `magic`, expected one of `gray`"),
        (lambda rig: nelu3d.decode(rig, "ball", "phase", gamma=-1), r"setting `gamma` is -1: give a positive number"),
        (lambda rig: nelu3d.sequence(rig, "leg"), r"no sequence `leg`; the rig has: hand"),
        (lambda rig: nelu3d.ColorField.load(rig.root / "rig.toml"), r"rig\.toml"),
        (lambda rig: nelu3d.evaluate(rig.root, rig.root), r"is no result folder"),
        (lambda rig: nelu3d.patterns("plaid", size=(9, 9)), r"unknown variant `plaid`"),
        (lambda rig: nelu3d.patterns(size=(9, 9)), r"."),
        (lambda rig: nelu3d.simulate("nothing", rig.root / "x"), r"neither a preset \(demo, "),
    ],
)
def test_sentences(rig, call, sentence):
    with pytest.raises(nelu3d.Error) as caught:
        call(rig)
    text = str(caught.value)
    assert re.search(sentence, text) and "\n" not in text and "panicked" not in text, text


def test_arrays_that_cannot_be_used(rig):
    white = np.zeros((120, 160), np.uint8)
    good = {"white": white, "p": white}

    def attempt(sentence, scene=good, **other):
        arguments = {"camera": rig.camera, "patterns": ["p"], "scenes": {"cup": scene}, **other}
        with pytest.raises(nelu3d.Error) as caught:
            nelu3d.Rig.from_arrays(**arguments).read("cup")
        assert re.search(sentence, str(caught.value)), str(caught.value)

    attempt(r"scenes/cup/p: is of type float64; give uint8", {**good, "p": white.astype(float)})
    attempt(r"scenes/cup/p: has the shape \[5\]; give height", {**good, "p": np.zeros(5, np.uint8)})
    attempt(r"scenes/cup/p: is 80x60 pixels, but its intrinsics say 160x120", {**good, "p": white[::2, ::2]})
    attempt(r"scenes/cup/p: there is no such image", {"white": white})
    attempt(r"cannot be|is 8-bit|never reaches", saturation=4095)
    attempt(r"scenes: is no dictionary of names", scenes=3)
    attempt(r"no name", scenes={"../cup": good})
    attempt(r"holds NaN at pixel \(3, 2\)", {**good, "p": with_nan(white)})
    attempt(r"pattern_sets|no images|images", patterns=[])
    attempt(r"there are no images", scenes={})
    with pytest.raises(nelu3d.Error, match="has no folder to look for a color field in"):
        nelu3d.reconstruct(nelu3d.Rig.from_arrays(camera=rig.camera, patterns=["p"], scenes={"cup": good}), "cup")


def with_nan(image):
    """The image as floats, one of which is none."""
    out = image.astype(np.float32)
    out[2, 3] = np.nan
    return out


def test_bad_results_are_refused_and_can_be_had(rig, field):
    """Patterns in the wrong order: the surface is refused, and comes with the exception."""
    root = rig.root / "scenes" / "ball"
    from PIL import Image

    read = lambda name: np.asarray(Image.open(root / name)).astype(np.uint16)
    names = rig.pattern_sets["two"]
    shot = {"white.png": read("white.png"), "black.png": read("black.png")}
    shot.update({names[0]: read(names[1]), names[1]: read(names[0])})
    wrong = nelu3d.Rig.from_arrays(camera=rig.camera, patterns={"two": names}, scenes={"ball": shot},
                                   white="white.png", black="black.png", black_level=64, saturation=4095)
    with pytest.warns(nelu3d.ScanWarning):
        try:
            found = nelu3d.reconstruct(wrong, "ball", field)
            assert found.verdict == "doubtful" and found.warnings
        except nelu3d.Refused as refused:
            assert refused.result.verdict == "bad" and "accept=True" in str(refused)
            assert nelu3d.reconstruct(wrong, "ball", field, accept=True).verdict == "bad"


def test_progress_is_told_and_its_exceptions_stop_the_work(rig, field):
    told = []
    nelu3d.reconstruct(rig, "ball", field, progress=lambda *report: told.append(report))
    stages = [stage for stage, _, total in told if total == 0]
    assert "read the scene" in stages and "build the surface" in stages, stages
    assert all(0 <= done <= total for _, done, total in told)

    def stop(stage, done, total):
        raise RuntimeError("enough")

    with pytest.raises(RuntimeError, match="enough"):
        nelu3d.calibrate(rig, progress=stop)


def test_other_threads_go_on(rig):
    """The interpreter is free while the library works."""
    ticks, done = [], threading.Event()

    def tick():
        while not done.is_set():
            ticks.append(time.perf_counter())
            time.sleep(0.005)

    thread = threading.Thread(target=tick)
    thread.start()
    try:
        nelu3d.calibrate(rig)
    finally:
        done.set()
        thread.join()
    gaps = np.diff(ticks)
    assert len(gaps) > 10 and np.median(gaps) < 0.1, (len(gaps), gaps.max())


@pytest.mark.skipif(os.name != "posix", reason="signals as POSIX has them")
def test_ctrl_c_stops_a_long_work_soon_and_leaves_nothing(rig, field, tmp_path):
    # What a shell starts in the background inherits a SIGINT that is ignored, and Python leaves it so.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    field.save(tmp_path / "f.safetensors")
    script = textwrap.dedent(
        f"""
        import nelu3d, signal
        signal.signal(signal.SIGINT, signal.default_int_handler)
        rig = nelu3d.Rig.open({str(rig.root)!r})
        say = lambda stage, done, total: print(stage, done, flush=True)
        try:
            nelu3d.reconstruct(rig, "ball", {str(tmp_path / "f.safetensors")!r}, recipe="paper", steps=100000,
                               device="cpu", progress=say)
        except KeyboardInterrupt:
            print("stopped", flush=True)
            # The interpreter and the library are as good as before.
            nelu3d.reconstruct(rig, "ball", {str(tmp_path / "f.safetensors")!r})
            print("and went on", flush=True)
        """
    )
    process = subprocess.Popen([sys.executable, "-c", script], stdout=subprocess.PIPE, text=True)
    # A work that does not stop is to fail the test, not to hang it.
    watchdog = threading.Timer(120, process.kill)
    watchdog.start()
    for line in process.stdout:
        if not line.startswith("read"):
            break
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    asked = time.perf_counter()
    rest = []
    for line in process.stdout:
        rest.append(line.strip())
        if line.startswith("stopped"):
            assert time.perf_counter() - asked < 60, "machines may be busy; one that is not takes a second"
    watchdog.cancel()
    assert process.wait(60) == 0
    assert rest[-1] == "and went on" and "stopped" in rest, rest[-5:]
    with pytest.raises(KeyboardInterrupt):
        simulate_and_interrupt(tmp_path / "new")
    assert not (tmp_path / "new").exists() and not list(tmp_path.glob(".new*")), list(tmp_path.iterdir())


def simulate_and_interrupt(output):
    """Presses Ctrl-C at the second report of a simulation."""
    reports = []

    def progress(*report):
        reports.append(report)
        if len(reports) == 2:
            os.kill(os.getpid(), signal.SIGINT)

    nelu3d.simulate("demo", output, progress=progress)
