"""`python -m rhs.report`."""

import sys

from rhs.reports.report import main

if __name__ == "__main__":
    sys.exit(main())
