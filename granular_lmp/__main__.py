"""``python -m granular_lmp`` is ``granular-lmp``."""

import sys

from granular_lmp.cli import main

sys.exit(main())
