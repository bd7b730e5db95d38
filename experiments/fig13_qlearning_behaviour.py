"""Figure 13 of the paper, the path of a Q-policy and its actions, box pushing.

python experiments/fig13_qlearning_behaviour.py RESULTS_FOLDER [--out FILE.png]
"""

import sys

from qboot.study.figures.catalogue import command

if __name__ == "__main__":
    sys.exit(command(13))
