"""Figure 14 of the paper, learning on the source set, box pushing.

python experiments/fig14_learning_on_source.py RESULTS_FOLDER [--out FILE.png]
"""

import sys

from qboot.study.figures.catalogue import command

if __name__ == "__main__":
    sys.exit(command(14))
