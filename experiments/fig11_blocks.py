"""Figure 11 of the paper, the domains of box pushing.

python experiments/fig11_blocks.py RESULTS_FOLDER [--out FILE.png]
"""

import sys

from qboot.study.figures.catalogue import command

if __name__ == "__main__":
    sys.exit(command(11))
