"""`python -m rhs`, and the console script."""

import signal
import sys

if signal.getsignal(signal.SIGINT) is signal.default_int_handler:  # Ctrl-C while this is loaded: no traceback
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from rhs.cli.main import entry

if __name__ == "__main__":
    sys.exit(entry())
