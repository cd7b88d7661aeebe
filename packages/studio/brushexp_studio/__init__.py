"""``task=studio``: serve a page on this machine on which users paint their photographs. Needs the extra.

photos (files of the user) -> wishes (what is chosen, as keys of the command line) -> works (paintings, one at a
time); tab (controls beside an easel, made of elements, of one visit) -> server (for this machine alone)

``task=view`` shows finished pages: view -> serving (to this machine alone), without the extra.
"""
