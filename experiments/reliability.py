"""Faults on purpose, and what they cost: kills, damaged files, bad command lines, a full disk (docs/reliability.md).

    python experiments/reliability.py kills commands damage disk
    python experiments/reliability.py kills --number 60 --seed 1

Prints a line per kind of fault, `times tried | lost or believed`, and every failure. Exit code 1 if there was one.
The disk is a tmpfs, mounted for the time of the trial: that takes root, and is skipped without.
"""

import argparse
import contextlib
import hashlib
import io
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

from qboot import cli
from qboot.envs import get_task
from qboot.study.pipeline import learning, loop, profiles
from qboot.study.pipeline.profiles import Size
from qboot.study.pipeline.table import STAGES
from qboot.study.store import runs

BALLS = get_task("ball_collecting")
_DEFAULTS = profiles.defaults_of(BALLS)
TINY = BALLS._replace(
    name="tiny_balls",
    paper=None,
    defaults=lambda: _DEFAULTS._replace(
        sizes={"smoke": Size(1, ("A", "B"), 8, 3, 240, 4, 3, 2, 1)},
        controls={"smoke": profiles.controls(1, actions=3, sensors=3, n_actions=3)},
        n_actions=(4, 17),
    ),
)
"""Ball collecting in seconds. Processes that load this file as their task save after every step."""
HERE = f"{Path(__file__).resolve()}:TINY"
if __name__.startswith("qboot_task"):
    loop.SECONDS_BETWEEN_SAVES = 0.0
    learning.EPISODES_PER_CALL = 1
# Not results: how and when a study was made.
ASIDE = {"config.json", "timing.csv", "report.html", "replay.html", ".lock"}
LATEST_KILL = 18.0  # seconds after a start, unless told otherwise; a tiny study takes a minute
SIGNALS = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT)
Failures = list[str]


def digests(folder: Path) -> dict[str, str]:
    """SHA-256 of every result below a folder."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file() and path.name not in ASIDE and not {".jax_cache", ".status"} & set(path.parts)
    }


def differing(found: dict[str, str], expected: dict[str, str]) -> list[str]:
    """Names of files that are missing, too many, or not the same."""
    return [name for name in sorted(found.keys() | expected.keys()) if found.get(name) != expected.get(name)]


def qboot(*arguments: str) -> tuple[int, str]:
    """Run a command in this process; its exit code and what it said. A traceback is an exit code 1."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        try:
            code = cli.main(list(arguments))
        except SystemExit as exit:  # from the parsers of arguments
            code = int(exit.code or 0)
        except Exception as error:
            return 1, f"{said.getvalue()}\nTRACEBACK {type(error).__name__}: {error}"
    return code, said.getvalue()


def reproduce(study: Path) -> list[str]:
    """The command for a tiny study, two jobs at a time."""
    return ["reproduce", "--task", HERE, "--profile", "smoke", "--out", str(study), "--jobs", "2"]


def run_all(folder: Path) -> list[tuple[int, str]]:
    """All stages on a run folder; the outcome of each."""
    return [qboot(stage.name, "--out", str(folder)) for stage in STAGES]


def start(arguments: list[str]) -> subprocess.Popen:
    """A command as a process of its own."""
    command = [sys.executable, "-m", "qboot.cli", *arguments]
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, start_new_session=True)


def orphans(folder: Path) -> list[int]:
    """Processes with the folder on their command lines."""
    found = []
    for path in Path("/proc").glob("[0-9]*/cmdline"):
        with contextlib.suppress(OSError):
            if str(folder).encode() in path.read_bytes():
                found.append(int(path.parent.name))
    return found


def kills(number: int, random_: random.Random, scratch: Path, latest: float = LATEST_KILL) -> Failures:
    """Kill a study, or a stage of a run, at random moments and go on, until all was done; compare with one in peace."""
    failures: Failures = []
    # What a shell starts in the background ignores Ctrl-C, and so would all that is started here.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    peaceful, study = scratch / "peaceful", scratch / "killed"
    process = start(reproduce(peaceful))
    if process.wait():
        return [f"the study in peace failed: {process.communicate()[1].decode()[-500:]}"]
    expected = digests(peaceful)
    done, finished, slowest, n_orphans, n_differing = 0, 0, 0.0, 0, 0
    by_signal = dict.fromkeys(SIGNALS, 0)
    while done < number:
        process = start(reproduce(study))
        number_of_signal = SIGNALS[done % len(SIGNALS)]
        try:
            process.wait(random_.uniform(2.0, latest))
        except subprocess.TimeoutExpired:
            sent = time.monotonic()
            process.send_signal(number_of_signal)
            process.wait()
            while (left := orphans(study)) and time.monotonic() < sent + 15:
                time.sleep(0.1)
            slowest = max(slowest, time.monotonic() - sent)
            done += 1
            by_signal[number_of_signal] += 1
            if left:
                n_orphans += len(left)
                failures.append(f"kill {done}, {number_of_signal.name}: orphans {left}")
            print(f"  kill {done}: {number_of_signal.name}, all gone after {time.monotonic() - sent:.1f} s", flush=True)
            continue
        if process.returncode:
            failures.append(f"exit code {process.returncode}: {process.communicate()[1].decode()[-500:]}")
            break
        finished += 1
        if names := differing(digests(study), expected):
            n_differing += len(names)
            failures.append(f"after {done} kills these files differ: {', '.join(names)}")
        shutil.rmtree(study)
    process = start(reproduce(study))
    process.wait()
    names = differing(digests(study), expected)
    n_differing += len(names)
    failures += [f"at the end these files differ: {', '.join(names)}"] if names else []
    counts = ", ".join(f"{n} {each.name}" for each, n in by_signal.items())
    print(
        f"kills | {done} ({counts}) of a study with two jobs, finished {finished + 1} times | {n_differing} files "
        f"differ, {n_orphans} orphans, all processes gone after {slowest:.1f} s at most"
    )
    return failures


DAMAGES: dict[str, Callable[[bytes, random.Random], bytes]] = {
    "empty": lambda content, _: b"",
    "cut in half": lambda content, _: content[: len(content) // 2],
    "last line lost": lambda content, _: content[: content[:-1].rfind(b"\n") + 1],
    "a byte flipped": lambda content, r: _flipped(content, r.randrange(len(content))),
    "a letter among numbers": lambda content, r: _lettered(content, r),
    "noise": lambda content, r: r.randbytes(len(content)),
    "too long": lambda content, _: content + content[-20:],
}


def _flipped(content: bytes, place: int) -> bytes:
    return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]


def _lettered(content: bytes, random_: random.Random) -> bytes:
    digits = [i for i, byte in enumerate(content) if 48 <= byte <= 57]
    place = random_.choice(digits)
    return content[:place] + b"x" + content[place + 1 :]


def damage(number: int, random_: random.Random, scratch: Path) -> Failures:
    """Damage each kind of file in each way, or put another run's in its place; then every reader is called."""
    study = scratch / "damaged"
    folder = study / "tiny_balls" / "A-0"
    for out, seed in ((folder, "0"), (scratch / "other", "1")):
        qboot("evolve", "--task", HERE, "--profile", "smoke", "--seed", seed, "--out", str(out))
        if codes := [outcome for outcome in run_all(out) if outcome[0]]:
            return [f"the run in peace failed: {codes}"]
    expected, kept = digests(folder), scratch / "kept"
    shutil.copytree(folder, kept)
    names = ["config.json", "files.json", *(name for stage in STAGES for name in stage.makes)]
    cases = [(name, way) for name in names for way in (*DAMAGES, "another run's", "a folder")]
    random_.shuffle(cases)
    failures: Failures = []
    tried = 0

    def fail(name: str, way: str, reader: str, said: str) -> None:
        failures.append(f"{name}, {way}, {reader}: {said.strip()[-300:]}")

    for case, (name, way) in enumerate(cases):
        if tried >= number:
            break
        shutil.rmtree(folder)
        shutil.copytree(kept, folder)
        path = folder / name
        if way == "a folder":
            path.unlink()
            path.mkdir()
        elif way == "another run's":
            shutil.copy(scratch / "other" / name, path)
        else:
            path.write_bytes(DAMAGES[way](path.read_bytes(), random_))
        is_noticed = name in ("config.json", "files.json") or way != "a folder"
        readers = {"replay": lambda: qboot("replay", "--out", str(folder))}
        if case % 4 == 0:  # the slowest
            readers["report"] = lambda: qboot("report", "--out", str(study))
        readers |= {stage.name: lambda stage=stage: qboot(stage.name, "--out", str(folder)) for stage in STAGES}
        outcomes = {}
        for reader, read in readers.items():
            tried += 1
            outcomes[reader] = code, said = read()
            if code not in (0, 2) or "Traceback" in said:
                fail(name, way, reader, said)
            if code == 2 and (said.count("qboot: ") < 1 or str(folder) not in said):
                fail(name, way, reader, f"no advice: {said}")
        if name in ("lineage.npz", "actions.npz", "sensors.npz", "qnets.npz") and outcomes["replay"][0] != 2:
            fail(name, way, "replay", "believed")
        if is_noticed and all(code == 0 for code, _ in list(outcomes.values())[-len(STAGES) :]):
            left = {n: d for n, d in digests(folder).items() if ".set-aside" not in n}
            if name == "config.json":
                left |= {n: d for n, d in expected.items() if n not in left}
            if wrong := differing(left, expected):
                fail(name, way, "stages", f"made {', '.join(wrong)} otherwise")
    print(f"damaged or foreign files | {tried} readings of {len(names)} kinds of files | {len(failures)} failures")
    return failures


def bad_commands() -> Iterator[list[str]]:
    """Command lines that cannot work."""
    new = ["evolve", "--task", "ball_collecting", "--profile", "smoke", "--out", "new"]
    numbers = ("-1", "nan", "inf", "-inf", "abc", "", "1e400", "0x10", "99999999999999999999")
    for option in ("--n-steps", "--episodes", "--evolution.population", "--learner.hidden", "--learner.lags"):
        for value in (*numbers, "0", "1.5", "2147483647"):
            if (option, value) != ("--episodes", "2147483647"):
                yield [*new, option, value]
    for option in ("--learner.alpha", "--learner.gamma", "--dnn.weight-limit", "--actions.fuzziness"):
        yield from ([*new, option, value] for value in (*numbers[:6], "1e400"))
    for option, values in {
        "--evolution.rates.polynomial-index": ("-1", "nan", "inf"),
        "--evolution.population": ("1", "1000000"),
        "--evolution.generations": ("-1", "4294967295"),
        "--evolution.diversities": ("beauty",),
        "--evolution.algorithm": ("magic",),
        "--dnn.weight-limit": ("0", "-5"),
        "--dnn.n-inputs": ("12", "0"),
        "--dnn.n-outputs": ("2", "4"),
        "--dnn.max-hidden": ("-1", "1000000"),
        "--dnn.max-connections": ("10",),
        "--learner.lags": ("3",),
        "--learner.history": ("never",),
        "--learner.eta": ("-1",),
        "--learner.hidden": ("1000000000",),
        "--sensors.lags": ("0", "13", "1000000"),
        "--sensors.rule": ("dice",),
        "--sensors.alpha": ("0", "1", "nan"),
        "--actions.n-actions": ("0", "100000"),
        "--actions.min-duration": ("0", "101"),
        "--actions.scale": ("other",),
        "--actions.tolerance": ("-1", "nan"),
        "--n-steps": ("8", "2000000000"),
        "--target-episodes": ("0",),
        "--target-generations": ("-1",),
        "--physics": ("foo",),
        "--seed": ("-1", "4294967303", "1.5", "x"),
        "--source": ("Z", ""),
        "--profile": ("huge", ""),
        "--workers": ("0", "-1", "x"),
        "--colour": ("red",),
    }.items():
        yield from ([*new, option, value] for value in values)
    yield from (["evolve", "--task", task, "--out", "new"] for task in ("", "flying", "a:b", "x.py:T", "os:path", ":"))
    for stage in ("extract", "learn", "transfer", "replay", "report"):
        yield from ([stage, "--out", "new"], [stage, "--out", "x" * 300], [stage, "--out", "/dev/null/x"], [stage])
    yield from (["ablate", "--task", "box_pushing", "--out", "new"], ["ablate", "--task", "flying"], ["ablate"])
    for option, value in (("--runs", "0"), ("--episodes", "0"), ("--lanes", "0"), ("--what", "colours")):
        yield ["ablate", "--task", "box_pushing", "--out", "new", option, value]
    for option, value in (("--jobs", "0"), ("--profile", "huge"), ("--task", "flying"), ("--out", "/dev/null/x")):
        yield ["reproduce", "--out", "new", option, value]
    yield from ([*new[:-1], out] for out in ("x" * 300, "/proc/new", "/dev/null/x", "/dev/null", "a/" * 2500))
    yield from (["nothing"], [], ["evolve", "--out"], ["learn", "--out", "new", "--seed", "3"])


def commands(number: int, random_: random.Random, scratch: Path) -> Failures:
    """Bad command lines: one message, exit code 2, nothing left behind."""
    failures: Failures = []
    here, tried = Path.cwd(), 0
    empty = scratch / "empty"
    empty.mkdir()
    os.chdir(empty)
    try:
        for arguments in bad_commands():
            tried += 1
            code, said = qboot(*arguments)
            if code != 2 or not said.strip() or "Traceback" in said or "TRACEBACK" in said:
                failures.append(f"{' '.join(arguments)[-200:]!r} gives {code}: {said[-300:]}")
            if left := list(empty.iterdir()):
                failures.append(f"{' '.join(arguments)[-200:]!r} leaves {left[0].name[:50]}")
                shutil.rmtree(left[0])
    finally:
        os.chdir(here)
    print(f"bad command lines | {tried} | {len(failures)} failures")
    return failures


def disk(number: int, random_: random.Random, scratch: Path) -> Failures:
    """A disk that is full when a stage wants to write: one line, nothing half-written; then there is room again."""
    small = scratch / "small"
    small.mkdir()
    if subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8m", "tmpfs", str(small)], capture_output=True).returncode:
        print("full disk | not tried: mounting takes root |")
        return []
    failures: Failures = []
    tried = 0
    try:
        peaceful, folder, filler = scratch / "roomy", small / "run", small / "filler"
        begin = ["evolve", "--task", HERE, "--profile", "smoke", "--out"]
        qboot(*begin, str(peaceful))
        run_all(peaceful)
        runs.create(folder, replace(runs.load(peaceful).settings))
        for stage in STAGES:
            for room in (0, 4096, 12288):
                filler.write_bytes(b"")
                with contextlib.suppress(OSError), filler.open("wb", buffering=0) as stream:
                    while True:
                        stream.write(bytes(4096))
                os.truncate(filler, max(0, filler.stat().st_size - room))
                tried += 1
                code, said = qboot(stage.name, "--out", str(folder))
                if code not in (0, 2) or (code == 2 and "make room" not in said):
                    failures.append(f"{stage.name} with {room} bytes left gives {code}: {said[-300:]}")
                if parts := list(folder.glob(".*.part")):
                    failures.append(f"{stage.name} leaves {parts}")
                filler.unlink()
            code, said = qboot(stage.name, "--out", str(folder))
            if code:
                failures.append(f"{stage.name} with room again gives {code}: {said[-300:]}")
        if names := differing(digests(folder), digests(peaceful)):
            failures.append(f"these files differ: {', '.join(names)}")
        subprocess.run(["mount", "-o", "remount,ro", str(small)], check=True)
        for stage in (*(stage.name for stage in STAGES), "replay"):
            tried += 1
            code, said = qboot(stage, "--out", str(folder))
            if code != (2 if stage == "replay" else 0):
                failures.append(f"{stage} on a read-only disk gives {code}: {said[-300:]}")
    finally:
        subprocess.run(["umount", str(small)], check=False)
    print(f"full and read-only disk | {tried} | {len(failures)} failures")
    return failures


TRIALS = {"kills": (kills, 60), "commands": (commands, 150), "damage": (damage, 200), "disk": (disk, 1)}


def main() -> int:
    """Run the trials that are named, all by default."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("trials", nargs="*", metavar="TRIAL", help=", ".join(TRIALS), default=[])
    parser.add_argument(
        "--number",
        type=int,
        help="of kills, or of readings of damaged files (commands and disk try all that they have); default as in "
        "docs/reliability.md",
    )
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--latest", type=float, default=LATEST_KILL, help="of kills, in seconds after a start")
    options = parser.parse_args()
    failures: Failures = []
    for name in options.trials or TRIALS:
        trial, number = TRIALS[name]
        trial = partial(trial, latest=options.latest) if trial is kills else trial
        with tempfile.TemporaryDirectory() as scratch:
            failures += trial(options.number or number, random.Random(options.seed), Path(scratch))
    print(*failures, sep="\n")
    return bool(failures)


if __name__ == "__main__":
    sys.exit(main())
