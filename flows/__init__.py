"""Prefect around :mod:`bella.pipeline`: schedule, limits, retries and states; a flow calls the pipeline and returns.

Nothing of Prefect is imported before :func:`bella.pipeline.workers.prepare` has told it where to live.
"""

import os

from bella.exceptions import require_extra
from bella.threads import ONE_THREAD

os.environ.update({**ONE_THREAD, **os.environ})  # before anything loads numpy
require_extra("prefect")
