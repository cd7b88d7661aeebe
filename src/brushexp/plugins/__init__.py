"""The families of plugins that ship: one folder each, ``base.py`` is the contract, every other file a plugin."""
