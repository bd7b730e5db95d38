"""Figure 12 of the paper, the path of a best evolved network, box pushing.

python experiments/fig12_evolved_behaviour.py RESULTS_FOLDER [--out FILE.png]
"""

import sys

from qboot.study.figures.catalogue import command

if __name__ == "__main__":
    sys.exit(command(12))
