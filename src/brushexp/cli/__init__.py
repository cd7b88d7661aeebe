"""The command line: words typed -> a composed config -> a run; help, and errors in one line."""
