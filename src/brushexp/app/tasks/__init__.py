"""What the program can do: one module and one file in conf/task/ for each. Pick one: ``task=paint``."""
