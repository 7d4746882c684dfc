"""``python -m bella.cli`` is ``bella``."""

from bella.cli.app import main

if __name__ == "__main__":
    main()
