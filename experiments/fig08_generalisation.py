"""Figure 8 of the paper, scores in new domains without learning there, ball collecting.

python experiments/fig08_generalisation.py RESULTS_FOLDER [--out FILE.png]
"""

import sys

from qboot.study.figures.catalogue import command

if __name__ == "__main__":
    sys.exit(command(8))
