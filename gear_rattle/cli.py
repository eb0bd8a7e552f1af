"""The entry of the command ``rattle``, which is installed with the library too, where what it needs is not there."""

import gc
import os
import sys
from importlib.metadata import version

REFUSED = 2
OBJECTS = 400_000  # that are made between two collections of garbage; Python's own default is 700

# Most of what lives is modules: to look for garbage in them took a fifth of a short command.
gc.set_threshold(OBJECTS)


def main() -> None:
    """Run the command; where it cannot be, say which extra has it."""
    os.environ["PYTHONSAFEPATH"] = "1"  # no process that a library starts imports from the working directory
    try:
        from gear_rattle.service.cli import main as run
    except ModuleNotFoundError as error:
        if error.name != "typer":
            raise
        sys.stderr.write(
            f"rattle {version('gear-rattle')}: only the library is installed. The command needs: "
            "pip install 'gear-rattle[cli]', or 'gear-rattle[service]' to serve surveys and the explorer.\n"
        )
        raise SystemExit(REFUSED) from None
    run()


if __name__ == "__main__":
    main()
