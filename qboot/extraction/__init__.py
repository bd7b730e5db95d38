"""From learning traces to the actions and sensors of a Q-learner (paper, sections IV-B to IV-D)."""

from qboot.extraction.clustering import fuzzy_c_means
from qboot.extraction.segmentation import split_points
from qboot.extraction.sensors import select_sensors

__all__ = ["fuzzy_c_means", "select_sensors", "split_points"]
