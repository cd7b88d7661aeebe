"""Run brushexp from a source tree: ``python run.py photo.jpg`` is equivalent to ``brushexp photo.jpg``.

Add ``-m`` to run a sweep, or ``--help`` to show the help.
"""

from brushexp.__main__ import main

if __name__ == "__main__":
    main()
