"""``python -m plumbline COMMAND ...`` is the command line of :mod:`.experiments`."""

from plumbline.experiments.commands.app import main

if __name__ == "__main__":
    main()
