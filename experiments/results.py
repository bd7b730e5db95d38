"""Make docs/results.md and its figures from a study, or from what was published of one.

python experiments/results.py RESULTS_FOLDER [--docs docs]
"""

import argparse
import sys
from pathlib import Path

from qboot.study.report import results
from qboot.study.store.files import RunError


def main() -> int:
    """Write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, metavar="RESULTS_FOLDER", help="folder of a study")
    parser.add_argument("--docs", type=Path, default=Path("docs"), help="folder of results.md and figures/")
    options = parser.parse_args()
    try:
        print(results.write(options.results, options.docs))
    except RunError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
