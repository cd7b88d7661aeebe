"""Members of the ``color`` family: colour spaces other than RGB in which paint is composited."""
