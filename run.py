"""``python run.py photo.jpg`` is ``brushexp photo.jpg``; add ``-m`` to sweep, ``--help`` to see the choices."""

from brushexp.__main__ import main

if __name__ == "__main__":
    main()
