"""The paper's figures on our runs: which there are, how each is drawn, and as a command (`experiments/fig*.py`)."""

import argparse
import io
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure

from qboot.study import figures_behaviour, figures_extraction, figures_scores, files
from qboot.study.curves import runs_below
from qboot.study.files import RunError
from qboot.study.runs import Run

DOTS_PER_INCH = 120


class Drawn(NamedTuple):
    """A figure and what it shows."""

    figure: Figure
    shows: str  # in a sentence or two, with our numbers
    runs: tuple[str, ...]  # labels of the runs that it was drawn from


class Plot(NamedTuple):
    """A figure of the paper: what it shows there, and how ours is drawn."""

    title: str
    paper: str
    draw: Callable[[list[Run]], tuple[Figure, str, list[str]]]  # runs of one task -> the fields of Drawn
    ball_collecting: int | None  # its number in the paper
    box_pushing: int | None
