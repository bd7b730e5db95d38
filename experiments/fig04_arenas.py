"""Figure 4 of the paper, the domains of ball collecting.

python experiments/fig04_arenas.py RESULTS_FOLDER [--out FILE.png]
"""

import sys

from qboot.study.figures.catalogue import command

if __name__ == "__main__":
    sys.exit(command(4))
