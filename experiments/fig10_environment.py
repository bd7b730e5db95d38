"""Figure 10 of the paper, the environment of box pushing.

python experiments/fig10_environment.py RESULTS_FOLDER [--out FILE.png]
"""

import sys

from qboot.study.figures.catalogue import command

if __name__ == "__main__":
    sys.exit(command(10))
