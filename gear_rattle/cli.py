"""The entry point of the command ``rattle``. It is installed even without the packages that the command needs."""

import gc
import os
import sys
from importlib.metadata import version

REFUSED = 2
GC_OBJECTS = 400_000  # new objects between two garbage collections; Python's default is 700

# With Python's default, garbage collections during imports took a fifth of the time of a short command.
gc.set_threshold(GC_OBJECTS)


def main() -> None:
    """Run the command, or print which extra to install if its packages are missing."""
    os.environ["PYTHONSAFEPATH"] = "1"  # processes that libraries start must not import from the working directory
    try:
        from gear_rattle.service.cli import main as run
    except ModuleNotFoundError as error:
        if error.name != "typer":
            raise
        sys.stderr.write(
            f"rattle {version('gear-rattle')}: only the library is installed. For the command: "
            "pip install 'gear-rattle[cli]', or 'gear-rattle[service]' to serve surveys and the explorer.\n"
        )
        raise SystemExit(REFUSED) from None
    run()


if __name__ == "__main__":
    main()
