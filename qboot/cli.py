"""The command line: `qboot STAGE --task T --profile P --source S --seed N --out DIR`."""

import argparse
import contextlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import qboot
from qboot.envs.registry import names
from qboot.study.pipeline import interruption
from qboot.study.pipeline.interruption import PARENT_VARIABLE, run_interruptible, stop_without
from qboot.study.pipeline.table import STAGES, stage

if TYPE_CHECKING:
    from qboot.study.store.runs import Run
    from qboot.study.store.settings import RunSettings

DESCRIPTION = """\
Bootstrap Q-learning for a robot from neuro-evolution: evolve networks from raw sensors and motors, extract actions
and sensors from the lineage of the best, learn with them, and compare all of it on new domains.
"""

EPILOG = """\
A run is a folder. The stages read and write it in turn, skip what is done and resume what was interrupted:

  qboot evolve   --task ball_collecting --profile quick --source A --seed 0 --out runs/A-0
  qboot extract  --out runs/A-0
  qboot learn    --out runs/A-0
  qboot transfer --out runs/A-0
  qboot replay   --out runs/A-0
  qboot plot     runs/A-0        (its curves, also while a stage is at work)

The control experiments on finished runs (section VII), many learners in one program:

  qboot ablate   --task box_pushing --what actions sensors n_actions --profile quick --out results/quick

A whole study, several runs spread over the cores, and its report:

  qboot reproduce --profile quick --out results/quick
  qboot report    --out results/quick

A task is a registered one, or one of your own: --task package.module:TASK, or --task path/to/file.py:TASK.
`qboot STAGE --help` lists every setting of a stage, with the task's defaults.
"""


def main(arguments: list[str] | None = None) -> int:
    """Run a command; return the exit code.

    0 done, 2 bad input or nothing to write on, 130 interrupted (143 by SIGTERM, 129 by SIGHUP), 141 output cut off.
    """
    if parent := os.environ.pop(PARENT_VARIABLE, ""):
        stop_without(int(parent))
    code = _outcome(arguments)
    if arguments is None and interruption.is_left:
        os._exit(code)  # what is being computed is not waited for
    return code


def _outcome(arguments: list[str] | None) -> int:
    options, rest = _parser().parse_known_args(arguments)
    try:
        if rest and options.command not in [stage.name for stage in STAGES]:
            raise ValueError(f"unknown arguments {' '.join(rest)}: see `qboot {options.command} --help`")
        run_interruptible(lambda: _run_command(options, rest))
    except KeyboardInterrupt as error:
        _say("\nqboot: interrupted; the same command goes on from the last save")
        return getattr(error, "exit_code", 130)
    except BrokenPipeError:  # qboot evolve --help | head
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes it once more at the end
        return 141
    except Exception as error:
        if not (words := _in_words(error)):
            raise
        _say(f"qboot: {words}")
        return 2
    return 0


def _run_command(options: argparse.Namespace, rest: list[str]) -> None:
    from qboot.study.store import programs  # late, so that help is quick

    programs.write_whole()
    options.run(options, rest)


def _say(words: str) -> None:
    """A line to the user, if there is one still: whoever started this process may be gone, and it ends all the same."""
    with contextlib.suppress(OSError):
        print(words, file=sys.stderr)


def _in_words(error: Exception) -> str:
    """What the user can do about an error; empty if it is a mistake of the program."""
    # Libraries are imported late, so that help is quick.
    import jax

    from qboot.study.store import files

    if isinstance(error, files.RunError | ValueError):
        return str(error)
    if isinstance(error, OSError):
        return str(files.unusable("used", Path(str(error.filename or "a file")), error))
    if isinstance(error, MemoryError) or (
        isinstance(error, jax.errors.JaxRuntimeError) and "RESOURCE_EXHAUSTED" in str(error)
    ):
        return "there is not enough memory: choose a smaller population, n_steps or learner.hidden, or fewer --workers"
    return ""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "qboot", description=DESCRIPTION, epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--version", action="version", version=f"qboot {qboot.__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, help: str, run: Callable, add_help: bool = True) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=help, description=help, add_help=add_help)
        sub.set_defaults(run=run)
        return sub

    tasks = f"{', '.join(names())}, or where a task of your own is: package.module:TASK, path/to/file.py:TASK"
    profiles = "smoke, quick (default), standard or paper: how large"
    workers = "threads; they do not change results"
    for each in STAGES:
        # The help of a stage goes on with its settings, which depend on task and profile.
        sub = command(each.name, f"{each.help}: {', '.join(each.makes)}", _stage, add_help=False)
        sub.add_argument("-h", "--help", action="store_true", help=argparse.SUPPRESS)  # named with the settings
        sub.add_argument("--task", help=f"{tasks} (a new run needs it)")
        sub.add_argument("--profile", help=profiles)
        sub.add_argument("--source", help="source domains; default the task's first")
        sub.add_argument("--seed", type=int, help="seed of everything random, default 0")
        sub.add_argument("--out", type=Path, help="run folder; default results/PROFILE/TASK/SOURCE-SEED")
        if each.is_parallel:
            sub.add_argument("--workers", type=int, default=1, help=workers)
    sub = command("ablate", "control experiments on a study's runs: actions, sensors, number of actions", _ablate)
    sub.add_argument("--task", required=True, help=tasks)
    sub.add_argument("--what", nargs="+", metavar="WHAT", help="actions, sensors, n_actions; default all of them")
    sub.add_argument("--profile", default="quick", help=profiles)
    sub.add_argument("--runs", type=int, help="learners per condition; default as the profile says")
    sub.add_argument("--episodes", type=int, help="Q-learning episodes of each; default as the profile says")
    sub.add_argument(
        "--evolved",
        nargs="+",
        default=[],
        metavar="RUN",
        help="evolved runs that new learners start from, in turn, such as A-0 B-2; default all, the sources in turn",
    )
    sub.add_argument("--out", type=Path, help="folder of the study; default results/PROFILE")
    sub.add_argument("--lanes", type=int, help="learners side by side in a program, default 1")
    sub.add_argument("--workers", type=int, default=1, help="programs at a time; they do not change results")
    sub = command("replay", "an HTML page that plays the best network and the Q-policy of a run", _replay)
    sub.add_argument("--out", type=Path, required=True, help="run folder")
    sub = command("plot", "the learning curves of a run, also while it goes on, as a picture", _plot)
    sub.add_argument("run_folder", type=Path, metavar="RUN", help="run folder")
    sub.add_argument("--out", type=Path, metavar="FILE.png", help="default RUN/curves.png")
    sub = command("report", "one self-contained HTML page on all runs of a study", _report)
    sub.add_argument("--out", type=Path, required=True, help="folder of the study, for instance results/quick")
    sub = command("publish", "the small files behind a study's numbers and figures of scores, with checksums", _publish)
    sub.add_argument("--out", type=Path, required=True, help="folder of the study, for instance results/standard")
    sub.add_argument("--to", type=Path, required=True, help="folder to be made")
    sub = command("reproduce", "all runs of a study, spread over the cores, and the report", _reproduce)
    sub.add_argument("--profile", default="quick", help=profiles)
    sub.add_argument("--task", help="one task alone; default those of the paper")
    sub.add_argument("--physics", help="what that task runs on; default what it is on record with")
    sub.add_argument("--out", type=Path, help="folder of the study; default results/PROFILE")
    sub.add_argument("--jobs", type=int, help="runs at a time; default one per core")
    sub.add_argument(
        "--dry-run", action="store_true", help="list the jobs and the core-hours left on this machine; start nothing"
    )
    command("workflow", "where the workflow for Snakemake is: docs/cluster.md", _workflow)
    return parser


def _stage(options: argparse.Namespace, rest: list[str]) -> None:
    if options.help:
        _show_help(options)
        return
    workers = getattr(options, "workers", 1)
    _check_workers(workers)
    stage(options.command).do(_run(options, rest), workers)


def _check_workers(workers: int) -> None:
    if workers < 1:
        raise ValueError(f"--workers is {workers}: at least 1 thread is needed")


def _run(options: argparse.Namespace, rest: list[str]) -> "Run[RunSettings]":
    """The run that a stage is for: begun by `--task`, or found in `--out`."""
    from qboot.study.pipeline.checks import check
    from qboot.study.store import runs

    if options.task is None:
        if options.out is None:
            raise ValueError("say which run: --out DIR of one begun, or --task for a new one")
        given = [f"--{name}" for name in ("profile", "source", "seed") if getattr(options, name) is not None]
        if given or rest:
            raise ValueError(f"{' '.join(given + rest)} without --task: a run that exists has its settings already")
        return runs.load(options.out)
    settings = _settings(options, rest)
    check(settings)
    return runs.create(options.out or runs.folder_of(Path("results") / settings.profile, settings), settings)


def _settings(options: argparse.Namespace, rest: list[str]) -> "RunSettings":
    """Settings of a new run: the task's and the profile's, changed by what else was said on the command line."""
    from qboot.envs import get_task
    from qboot.study.pipeline import profiles

    source = get_task(options.task).sources[0] if options.source is None else options.source
    profile = "quick" if options.profile is None else options.profile
    settings = profiles.settings_of(options.task, profile, source, options.seed or 0)
    if not rest:
        return settings
    import tyro

    return tyro.cli(type(settings), default=settings, args=rest, prog=f"qboot {options.command}")


def _show_help(options: argparse.Namespace) -> None:
    groups: Any = _parser()._subparsers  # argparse has no public way to a subcommand's parser
    groups._group_actions[0].choices[options.command].print_help()
    print("\nEvery setting of a run can be changed when it is begun; these are the defaults:\n")
    options.task = options.task or names()[0]
    _settings(options, ["--help"])


def _ablate(options: argparse.Namespace, rest: list[str]) -> None:
    from qboot.envs import get_task
    from qboot.study.controls import cells, sweep
    from qboot.study.controls.conditions import WHATS
    from qboot.study.pipeline import profiles

    _check_workers(options.workers)
    study = options.out or Path("results") / options.profile
    # All names are known before anything is learned.
    sizes = {
        what: profiles.control_size_of(get_task(options.task), what, options.profile) for what in options.what or WHATS
    }
    for what, size in sizes.items():
        n_runs = size.runs if options.runs is None else options.runs
        n_episodes = size.episodes if options.episodes is None else options.episodes
        lanes = sweep.LANES if options.lanes is None else options.lanes
        planned = cells.plan(study, options.task, what, options.profile, n_runs, n_episodes, lanes, options.evolved)
        sweep.learn_cells(cells.begin(planned), options.workers)


def _replay(options: argparse.Namespace, rest: list[str]) -> None:
    from qboot.study.report import player
    from qboot.study.store import runs

    print(player.write(runs.load(options.out)))


def _plot(options: argparse.Namespace, rest: list[str]) -> None:
    from qboot.study.figures import catalogue
    from qboot.study.store import files, runs

    out = options.out or options.run_folder / "curves.png"
    if out.suffix != ".png":
        raise ValueError(f"--out is {out}: the picture is a PNG, give it a name that ends in .png")
    drawn = catalogue.draw_so_far(runs.load(options.run_folder))
    files.write(out, catalogue.as_png(drawn.figure))
    print(f"{out}: {drawn.shows}")


def _report(options: argparse.Namespace, rest: list[str]) -> None:
    from qboot.study.report import page

    print(page.write(options.out))


def _publish(options: argparse.Namespace, rest: list[str]) -> None:
    from qboot.study.store import publishing

    size = publishing.publish(options.out, options.to)
    print(f"{options.to}: {size / 1e6:.1f} MB, listed in {publishing.CHECKSUMS}")


def _reproduce(options: argparse.Namespace, rest: list[str]) -> None:
    from qboot.study import runner
    from qboot.study.report import page
    from qboot.study.store import files

    out = options.out or Path("results") / options.profile
    if options.dry_run:
        from qboot.study import dry_run

        for line in dry_run.lines(options.profile, options.task, out, options.physics):
            print(line)
        return
    try:
        runner.reproduce(options.profile, options.task, out, options.jobs, options.physics)
    except runner.Incomplete:
        with contextlib.suppress(files.RunError):  # what failed before is what the user has to know
            print(page.write(out))
        raise
    print(page.write(out))


def _workflow(options: argparse.Namespace, rest: list[str]) -> None:
    from qboot.study import workflow

    print(workflow.SNAKEFILE)


if __name__ == "__main__":
    sys.exit(main())
