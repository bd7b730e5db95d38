"""Bootstrapping Q-learning for robotics from neuro-evolution results."""

from qboot.xla import set_flags

__version__ = "0.2.0.dev0"

set_flags()
