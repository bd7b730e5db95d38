"""Figure 5 of the paper, the path of a best evolved network.

python experiments/fig05_evolved_behaviour.py RESULTS_FOLDER [--out FILE.png]
"""

import sys

from qboot.study.figures.catalogue import command

if __name__ == "__main__":
    sys.exit(command(5))
