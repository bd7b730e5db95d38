"""Figure 9 of the paper, learning in new domains, ball collecting.

python experiments/fig09_transfer.py RESULTS_FOLDER [--out FILE.png]
"""

import sys

from qboot.study.figures.catalogue import command

if __name__ == "__main__":
    sys.exit(command(9))
