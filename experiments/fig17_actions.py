"""Figure 17 of the paper, extracted, human-designed and random actions, of one task.

python experiments/fig17_actions.py RESULTS_FOLDER [--task TASK] [--out FILE.png]
"""

import sys

from qboot.study.figures.catalogue.catalogue import ablation_command

if __name__ == "__main__":
    sys.exit(ablation_command(17))
