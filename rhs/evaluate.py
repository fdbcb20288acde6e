"""`python -m rhs.evaluate`."""

import sys

from rhs.cli.evaluate import main

if __name__ == "__main__":
    sys.exit(main())
