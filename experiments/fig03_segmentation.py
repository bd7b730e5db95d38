"""Figure 3 of the paper, how commands are cut into linear actions.

python experiments/fig03_segmentation.py RESULTS_FOLDER [--out FILE.png]
"""

import sys

from qboot.study.figures.catalogue import command

if __name__ == "__main__":
    sys.exit(command(3))
