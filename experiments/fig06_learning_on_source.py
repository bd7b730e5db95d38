"""Figure 6 of the paper, learning on the source set, ball collecting.

python experiments/fig06_learning_on_source.py RESULTS_FOLDER [--out FILE.png]
"""

import sys

from qboot.study.figures.catalogue import command

if __name__ == "__main__":
    sys.exit(command(6))
