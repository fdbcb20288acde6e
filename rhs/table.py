"""`python -m rhs.table`."""

import sys

from rhs.reports.table import main

if __name__ == "__main__":
    sys.exit(main())
