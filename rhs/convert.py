"""`python -m rhs.convert`."""

import sys

from rhs.cli.convert import main

if __name__ == "__main__":
    sys.exit(main())
