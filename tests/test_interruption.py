"""Being stopped: at once, with what is unsaved saved, and nothing that goes on."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from qboot.study import processes
from qboot.study.pipeline import interruption, loop
from qboot.study.pipeline.interruption import PARENT_VARIABLE, Interrupted, at_interrupt, run_interruptible
from qboot.study.pipeline.loop import Work
from qboot.study.store import lock
from qboot.study.store.files import RunError

posix = pytest.mark.skipif(os.name != "posix", reason="signals and processes are those of POSIX")


@pytest.fixture
def heard():
    """All signals as a terminal leaves them: what a shell puts in the background, or nohup starts, ignores some."""
    before = {number: signal.getsignal(number) for number in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)}
    for number in before:
        signal.signal(number, signal.default_int_handler if number == signal.SIGINT else signal.SIG_DFL)
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


@posix
@pytest.mark.usefixtures("heard")
@pytest.mark.parametrize(("number", "code"), [(signal.SIGTERM, 143), (signal.SIGINT, 130), (signal.SIGHUP, 129)])
def test_a_long_call_does_not_delay_the_end(number, code):
    """The loop is within a step that takes longer than anybody waits; the state before it is saved."""
    saved, in_second_step, released = [], threading.Event(), threading.Event()

    def step(state):
        if state == 1:
            in_second_step.set()
            os.kill(os.getpid(), number)
            released.wait(60)
        return state + 1

    work = Work(total=3, done=lambda state: state, step=step, save=saved.append, report=lambda state: None)
    before = signal.getsignal(number)
    started = time.monotonic()
    with pytest.raises(Interrupted) as stopped:
        run_interruptible(lambda: loop.advance(work, 0))
    assert time.monotonic() - started < 5
    assert in_second_step.is_set() and saved == [1]
    assert stopped.value.exit_code == code
    assert interruption.is_left
    assert signal.getsignal(number) == before
    released.set()


def test_what_work_raises_is_raised():
    def fail():
        raise RunError("no space")

    with pytest.raises(RunError, match="no space"):
        run_interruptible(fail)


def test_a_failing_step_leaves_what_was_before_it_saved():
    saved = []

    def step(state):
        if state == 2:
            raise RunError("diverged")
        return state + 1

    work = Work(total=5, done=lambda state: state, step=step, save=saved.append, report=lambda state: None)
    with pytest.raises(RunError, match="diverged"):
        loop.advance(work, 0)
    assert saved == [2]


def test_actions_are_for_their_context_alone():
    def action():
        pass

    with at_interrupt(action):
        assert action in interruption._actions.values()
    assert action not in interruption._actions.values()


@posix
def test_a_process_stops_when_the_one_that_started_it_is_killed():
    """A parent starts a child that watches it; the parent is killed; the child, polite, saves and goes."""
    child = (
        "import os, time\n"
        "from qboot.study.pipeline.interruption import Interrupted, run_interruptible, stop_without, PARENT_VARIABLE\n"
        "stop_without(int(os.environ[PARENT_VARIABLE]))\n"
        "print(os.getpid(), flush=True)\n"
        "try: run_interruptible(lambda: time.sleep(600))\n"
        "except Interrupted as error: print('stopped', error.exit_code, flush=True)\n"
        "os._exit(0)\n"
    )
    parent = (
        "import os, subprocess, sys\n"
        f"environment = os.environ | {{{PARENT_VARIABLE!r}: str(os.getpid())}}\n"
        f"subprocess.run([sys.executable, '-c', {child!r}], env=environment)\n"
    )
    process = subprocess.Popen([sys.executable, "-c", parent], stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    int(process.stdout.readline())  # the child is at work
    process.kill()
    assert process.stdout.readline().split() == ["stopped", "143"]
    assert process.stdout.read() == ""  # and has ended
    process.wait()


@posix
def test_a_process_ends_at_once_when_nobody_hears_its_last_words():
    """As when the process that reads them was killed, while a thread that Python would wait for computes."""
    code = (
        "import sys, time\n"
        "from concurrent.futures import ThreadPoolExecutor\n"
        "from qboot import cli\n"
        "def work(options, rest):\n"
        "    with ThreadPoolExecutor(1) as pool:\n"
        "        print('at work', flush=True)\n"
        "        pool.submit(time.sleep, 60).result()\n"
        "cli._report = work\n"
        "sys.argv = ['qboot', 'report', '--out', 'nowhere']\n"
        "sys.exit(cli.main())\n"
    )
    process = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None and process.stderr is not None
    assert process.stdout.readline() == "at work\n"
    process.stderr.close()
    process.terminate()
    assert process.wait(20) == 143
    process.stdout.close()


@posix
def test_a_signal_that_another_thread_gets_is_heard():
    """The kernel chooses the thread, and none but the main one's sleep would end."""
    code = (
        "import os, signal, threading, time\n"
        "from qboot.study.pipeline.interruption import Interrupted, run_interruptible\n"
        "def work():\n"
        "    time.sleep(1)  # until the main thread sleeps\n"
        "    signal.pthread_kill(threading.get_ident(), signal.SIGTERM)\n"
        "    time.sleep(600)\n"
        "try: run_interruptible(work)\n"
        "except Interrupted as error: os._exit(error.exit_code)\n"
    )
    assert subprocess.run([sys.executable, "-c", code], timeout=30).returncode == 143


@posix
def test_processes_are_stopped_together(monkeypatch):
    monkeypatch.setattr(processes, "SECONDS_TO_STOP", 0.5)
    monkeypatch.setattr(processes, "_stopping", threading.Event())
    codes = []
    stubborn = "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); time.sleep(600)"

    def run(code):
        codes.append(processes.run([sys.executable, "-c", code], dict(os.environ)).returncode)

    threads = [threading.Thread(target=run, args=[code]) for code in ("import time; time.sleep(600)", stubborn)]
    for thread in threads:
        thread.start()
    while len(processes._running) < 2:
        time.sleep(0.01)
    time.sleep(1.0)  # the stubborn one stops listening
    processes.stop_all()
    for thread in threads:
        thread.join(30)
    assert set(codes) <= {-signal.SIGTERM, -signal.SIGKILL} and len(codes) == 2
    run("print()")  # no other one starts
    assert codes[-1] == 143


@posix
def test_a_folder_has_one_owner(tmp_path):
    code = (
        "import sys, pathlib\n"
        "from qboot.study.store import lock\n"
        f"with lock.owned(pathlib.Path({str(tmp_path)!r})): print('mine', flush=True); sys.stdin.read()\n"
    )
    owner = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert owner.stdout is not None and owner.stdout.readline() == "mine\n"
    words = rf"in use by process {owner.pid} on \S+: wait until it is done, or stop it first$"
    with pytest.raises(RunError, match=words), lock.owned(tmp_path):
        pass
    owner.kill()
    owner.wait()
    (tmp_path / f".lineage.npz.{owner.pid}.part").write_text("half")
    assert (tmp_path / lock.LOCK).exists()  # the dead owner's name is still there
    with lock.owned(tmp_path):
        assert not list(tmp_path.glob("*.part"))
    assert not list(tmp_path.iterdir())


@posix
def test_without_locks_of_the_file_system_the_owners_life_counts(tmp_path, monkeypatch):
    def none(*arguments):
        raise OSError(38, "Function not implemented")

    monkeypatch.setattr(lock.fcntl, "flock", none)
    path = tmp_path / lock.LOCK
    host = lock.socket.gethostname()
    path.write_text(f"process 1 on {host}\n")  # process 1 always lives
    with pytest.raises(RunError, match=f"in use by process 1 .*; if it has ended already, delete {path}"):
        lock.owned(tmp_path).__enter__()
    path.write_text("process 1 on another-machine\n")
    with pytest.raises(RunError, match=f"on another-machine: .*; if it has ended already, delete {path}"):
        lock.owned(tmp_path).__enter__()
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    path.write_text(f"process {gone.pid} on {host}\n")
    with lock.owned(tmp_path):
        pass
