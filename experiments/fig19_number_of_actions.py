"""Figure 19 of the paper, the number of actions, of one task.

python experiments/fig19_number_of_actions.py RESULTS_FOLDER [--task TASK] [--out FILE.png]
"""

import sys

from qboot.study.figures.catalogue import command

if __name__ == "__main__":
    sys.exit(command(19))
