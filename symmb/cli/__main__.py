"""`python -m symmb.cli` does what `symmb` does."""

import sys

from symmb.cli.main import main

sys.exit(main())
