"""The ``bella`` command: one module per group of commands, each reads options, calls a room and prints its answer."""

import os

from bella.threads import ONE_THREAD

os.environ.update({**ONE_THREAD, **os.environ})  # before anything loads numpy

from bella.cli.app import app, main

__all__ = ["app", "main"]
