"""Work that ends its process as a lack of memory does. Apart: a process that is given it loads this module, no more."""

import os
import signal


def die(*_: object) -> None:
    os.kill(os.getpid(), signal.SIGKILL)
