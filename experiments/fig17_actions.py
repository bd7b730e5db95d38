"""Figure 17 of the paper, extracted, human-designed and random actions, of one task.

python experiments/fig17_actions.py RESULTS_FOLDER [--task TASK] [--out FILE.png]
"""

import sys

from qboot.study.figures.catalogue import command

if __name__ == "__main__":
    sys.exit(command(17))
