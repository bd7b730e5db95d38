"""Figure 16 of the paper, learning in new domains, box pushing.

python experiments/fig16_transfer.py RESULTS_FOLDER [--out FILE.png]
"""

import sys

from qboot.study.figures.catalogue import command

if __name__ == "__main__":
    sys.exit(command(16))
