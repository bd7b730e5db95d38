"""The command line: `qboot STAGE --task T --profile P --source S --seed N --out DIR`."""

import argparse
import os
import sys
from collections.abc import Callable
from pathlib import Path

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

The control experiments on finished runs (section VII), many learners in one program:

  qboot ablate   --task box_pushing --what actions sensors n_actions --profile quick --out results/quick

A whole study, several runs spread over the cores, and its report:

  qboot reproduce --profile quick --out results/quick
  qboot report    --out results/quick

`qboot STAGE --help` lists every setting of a stage, with the paper's values as defaults.
"""

STAGE_HELP = {
    "evolve": "neuro-evolution on the source set: history.csv, lineage.npz, pareto.npz",
    "extract": "actions and sensors from the lineage's traces: actions.npz, sensors.npz",
    "learn": "Q-learning on the source set: qlearning.csv, qnets.npz",
    "transfer": "new domains, without and with learning: generalisation.csv, transfer.csv",
}


def main(arguments: list[str] | None = None) -> int:
    """Run a command; return the exit code: 0 done, 2 bad input, 130 interrupted, 141 output cut off."""
    parser = _parser()
    arguments = sys.argv[1:] if arguments is None else arguments
    options, rest = parser.parse_known_args(arguments)
    # Libraries are imported late, so that help is quick.
    from qboot.study.store.files import RunError

    try:
        if rest and options.command not in STAGE_HELP:
            raise RunError(f"unknown arguments {' '.join(rest)}: see `qboot {options.command} --help`")
        options.run(options, rest)
    except (RunError, ValueError) as error:
        print(f"qboot: {error}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        print("qboot: interrupted; the same command goes on from the last save", file=sys.stderr)
        return 130
    except BrokenPipeError:  # qboot evolve --help | head
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())  # Python flushes it once more at the end
        return 141
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        "qboot", description=DESCRIPTION, epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, help: str, run: Callable, add_help: bool = True) -> argparse.ArgumentParser:
        sub = commands.add_parser(name, help=help, description=help, add_help=add_help)
        sub.set_defaults(run=run)
        return sub

    for name, help in STAGE_HELP.items():
        # The help of a stage goes on with its settings, which depend on task and profile.
        sub = command(name, help, _stage, add_help=False)
        sub.add_argument("-h", "--help", action="store_true", help="show this help and all settings")
        sub.add_argument("--task", help="ball_collecting or box_pushing (a new run needs it)")
        sub.add_argument("--profile", help="smoke, quick (default), standard or paper: how large")
        sub.add_argument("--source", help="source domains, A (default), B or C")
        sub.add_argument("--seed", type=int, help="seed of everything random, default 0")
        sub.add_argument("--out", type=Path, help="run folder; default results/PROFILE/TASK/SOURCE-SEED")
        sub.add_argument("--workers", type=int, default=1, help="threads; they do not change results")
    sub = command("ablate", "control experiments on a study's runs: actions, sensors, number of actions", _ablate)
    sub.add_argument("--task", required=True, help="ball_collecting or box_pushing")
    sub.add_argument("--what", nargs="+", metavar="WHAT", help="actions, sensors, n_actions; default all of them")
    sub.add_argument("--profile", default="quick", help="smoke, quick (default), standard or paper: how large")
    sub.add_argument("--runs", type=int, help="learners per condition; default as the profile says")
    sub.add_argument("--episodes", type=int, help="Q-learning episodes of each; default as the profile says")
    sub.add_argument("--out", type=Path, help="folder of the study; default results/PROFILE")
    sub.add_argument("--lanes", type=int, help="learners side by side in a program; default as the profile says")
    sub.add_argument("--workers", type=int, default=1, help="programs at a time; they do not change results")
    sub = command("replay", "an HTML page that plays the best network and the Q-policy of a run", _replay)
    sub.add_argument("--out", type=Path, required=True, help="run folder")
    sub = command("report", "one self-contained HTML page on all runs of a study", _report)
    sub.add_argument("--out", type=Path, required=True, help="folder of the study, for instance results/quick")
    sub = command("reproduce", "all runs of a study, spread over the cores, and the report", _reproduce)
    sub.add_argument("--profile", default="quick", help="smoke, quick (default), standard or paper")
    sub.add_argument("--task", help="one task alone; default all")
    sub.add_argument("--out", type=Path, help="folder of the study; default results/PROFILE")
    sub.add_argument("--jobs", type=int, help="runs at a time; default one per core")
    return parser


def _stage(options: argparse.Namespace, rest: list[str]) -> None:
    if options.help:
        _show_help(options)
        return
    from qboot.study.pipeline.stages import STAGES
    from qboot.study.store import runs

    if options.workers < 1:
        raise ValueError(f"--workers is {options.workers}: at least 1 thread is needed")
    STAGES[options.command](_run(options, rest, runs), options.workers)


def _run(options: argparse.Namespace, rest: list[str], runs):
    """The run that a stage is for: begun by `--task`, or found in `--out`."""
    if options.task is None:
        if options.out is None:
            raise ValueError("say which run: --out DIR of one begun, or --task for a new one")
        given = [f"--{name}" for name in ("profile", "source", "seed") if getattr(options, name) is not None]
        if given or rest:
            raise ValueError(f"{' '.join(given + rest)} without --task: a run that exists has its settings already")
        return runs.load(options.out)
    settings = _settings(options, rest)
    default = Path("results") / settings.profile / settings.task / f"{settings.source}-{settings.seed}"
    return runs.create(options.out or default, settings)


def _settings(options: argparse.Namespace, rest: list[str]):
    """Settings of a new run: the profile's, changed by what else was said on the command line."""
    import tyro

    from qboot.study.pipeline import profiles

    values = options.task, options.profile or "quick", options.source or "A", options.seed or 0
    settings = profiles.settings_of(*values)
    if not rest:
        return settings
    return tyro.cli(type(settings), default=settings, args=rest, prog=f"qboot {options.command}")


def _show_help(options: argparse.Namespace) -> None:
    choices = _parser()._subparsers._group_actions[0].choices  # argparse has no public way to a subcommand's parser
    choices[options.command].print_help()
    print("\nEvery setting of a run can be changed when it is begun; these are the defaults:\n")
    options.task = options.task or "ball_collecting"
    _settings(options, ["--help"])


def _ablate(options: argparse.Namespace, rest: list[str]) -> None:
    from qboot.study.controls import conditions as ablations
    from qboot.study.controls import sweep
    from qboot.study.pipeline import profiles

    if options.workers < 1:
        raise ValueError(f"--workers is {options.workers}: at least 1 thread is needed")
    study = options.out or Path("results") / options.profile
    for what in options.what or ablations.WHATS:
        size = profiles.sweep_of(options.task, what, options.profile)
        n_runs = size.runs if options.runs is None else options.runs
        n_episodes = size.episodes if options.episodes is None else options.episodes
        lanes = profiles.LANES if options.lanes is None else options.lanes
        cells = ablations.begin(study, options.task, what, options.profile, n_runs, n_episodes, lanes)
        sweep.learn_cells(cells, options.workers)


def _replay(options: argparse.Namespace, rest: list[str]) -> None:
    from qboot.study.report.page import player as replay
    from qboot.study.store import runs

    print(replay.write(runs.load(options.out)))


def _report(options: argparse.Namespace, rest: list[str]) -> None:
    from qboot.study.report.page import page as report

    print(report.write(options.out))


def _reproduce(options: argparse.Namespace, rest: list[str]) -> None:
    from qboot.study import runner
    from qboot.study.report.page import page as report

    out = options.out or Path("results") / options.profile
    runner.share_compiled_programs(out)
    runner.reproduce(options.profile, options.task, out, options.jobs)
    print(report.write(out))


if __name__ == "__main__":
    sys.exit(main())
