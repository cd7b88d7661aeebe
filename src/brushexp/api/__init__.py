"""What ``import brushexp`` offers: the tasks of the command line as functions of Python."""
