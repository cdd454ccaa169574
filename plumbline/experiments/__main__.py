"""``python -m plumbline.experiments`` is the command line, too."""

from plumbline.experiments.commands.app import main

if __name__ == "__main__":
    main()
