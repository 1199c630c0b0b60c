"""``python -m gdg``: the ``gdg`` command of this very Python."""

from gdg.cli import main

if __name__ == "__main__":
    main()
