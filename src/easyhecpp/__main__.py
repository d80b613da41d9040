"""``python -m easyhecpp``."""

import sys

from easyhecpp.cli import main

sys.exit(main())
