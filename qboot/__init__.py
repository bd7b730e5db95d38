"""Bootstrapping Q-learning for robotics from neuro-evolution results."""

from qboot.xla import compile_small_loops

__version__ = "0.2.0.dev0"

compile_small_loops()
