"""Start of the command line: a signal that asks for its end is heeded while its modules are still being imported."""

from .signals import interruptible


def main() -> None:
    """Import the command line and run it, see `voxdepth.tools.cli.main`."""
    with interruptible():
        from .cli import main as run
    run()


if __name__ == "__main__":
    main()
