"""Run the program: ``python run.py photo.jpg`` is ``brushexp photo.jpg``; add ``-m`` to sweep, ``--help`` for help."""

from brushexp.__main__ import main

if __name__ == "__main__":
    main()
