"""The command ``tensionlab``, and ``python -m tensionlab``."""

import signal
import sys


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
        signal.signal(
            signal.SIGINT, signal.SIG_DFL
        )  # a second one does not wait for threads, nor show where they are


if __name__ == "__main__":
    main()
