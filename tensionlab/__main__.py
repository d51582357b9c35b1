"""The command ``tensionlab``, and ``python -m tensionlab``."""

import sys

if __name__ == "__main__" and not sys.flags.safe_path:
    del sys.path[0]  # the working directory, where anybody may have put a numpy.py

import signal


def main() -> None:
    """Run the command line; Ctrl-C ends it with a line and status 130 while it is still being imported, too."""
    try:
        from tensionlab.cli import main as run
    except KeyboardInterrupt:
        print("tensionlab: interrupted: nothing was begun", file=sys.stderr)
        raise SystemExit(130) from None
    try:
        run()
    finally:
        # A second one does not wait for threads, nor show where they are.
        signal.signal(signal.SIGINT, signal.SIG_DFL)


if __name__ == "__main__":
    main()
