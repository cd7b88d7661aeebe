"""From a command line to a task.

``brushexp photo.jpg`` passes through these modules until the picture is decoded::

    __main__              the program begins
    cli.program           plugins are loaded and published (config.publish)
      config.words        photo.jpg -> image=photo.jpg
      config.compose      words, presets and the user's configs -> Hydra -> cfg
      (runs.run_folder)   cfg is checked once (config.check), and the folder is taken
    runs.runner           cfg -> its task, in that folder
    tasks.paint           -> painting.build: the plugins that the check has built are taken (registry.take_built)
    pictures.load         the picture is decoded

Beside this way, `many_pictures` makes a sweep of several pictures, `help` answers ``--help``, and `config.mistakes`
says in the words of the program what Hydra and OmegaConf refuse.
"""
