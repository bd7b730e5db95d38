"""Figure 18 of the paper, sensors for the state, of one task.

python experiments/fig18_sensors.py RESULTS_FOLDER [--task TASK] [--out FILE.png]
"""

import sys

from qboot.study.figures.catalogue import command

if __name__ == "__main__":
    sys.exit(command(18))
