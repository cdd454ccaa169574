"""``python -m plumbline COMMAND ...`` is the command line of :mod:`.experiments`."""

from plumbline.experiments.__main__ import main

if __name__ == "__main__":
    main()
