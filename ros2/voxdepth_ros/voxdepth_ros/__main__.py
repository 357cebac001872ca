"""The command of the node. It handles signals before it imports much, so that they never end it with a traceback."""

from voxdepth.tools.signals import interruptible


def main() -> None:
    """Run the node until ROS or a signal ends it; then the exit code is 0."""
    with interruptible(exit_code=0):
        from .node import run

        run()


if __name__ == "__main__":
    main()
