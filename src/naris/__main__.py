"""`python -m naris` is `naris`."""

import sys

from naris.cli import main

if __name__ == "__main__":
    sys.exit(main())
