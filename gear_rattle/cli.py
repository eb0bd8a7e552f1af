"""The entry of the command ``rattle``, which is installed with the library too, where what it needs is not there."""

import sys
from importlib.metadata import version

REFUSED = 2


def main() -> None:
    """Run the command; where it cannot be, say which extra has it."""
    try:
        from service.cli import main as run
    except ModuleNotFoundError as error:
        if error.name != "typer":
            raise
        sys.stderr.write(
            f"rattle {version('gear-rattle')}: only the library is installed. The command needs: "
            "pip install 'gear-rattle[cli]', or 'gear-rattle[service]' to serve surveys and the explorer.\n"
        )
        raise SystemExit(REFUSED) from None
    run()
