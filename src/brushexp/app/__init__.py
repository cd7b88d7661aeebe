"""The program: command line, schemas of the tasks, the tasks themselves."""
