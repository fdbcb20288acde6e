"""`python -m rhs`."""

import sys

from rhs.cli.main import entry

if __name__ == "__main__":
    sys.exit(entry())
