"""`python -m rhs.planner_arena`."""

import sys

from rhs.reports.arena_log import main

if __name__ == "__main__":
    sys.exit(main())
