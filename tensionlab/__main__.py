"""``python -m tensionlab`` is the command ``tensionlab``."""

from tensionlab.cli import main

if __name__ == "__main__":
    main()
