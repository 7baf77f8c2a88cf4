"""`python -m uvms_drake` is the command `uvms-drake`."""

import sys

from uvms_drake.command.main import main

sys.exit(main())
