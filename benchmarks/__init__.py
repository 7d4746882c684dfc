"""What docs/speed.md says about speed, measured: ``make bench``."""

import os

from bella.threads import ONE_THREAD

os.environ.update({**ONE_THREAD, **os.environ})  # before anything loads numpy: waiting threads would count as CPU time
