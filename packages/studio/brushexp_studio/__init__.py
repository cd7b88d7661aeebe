"""``task=studio``: a page in the browser on this machine, to paint one's own photographs and watch. Needs the extra.

photos (files of the visitor) -> wishes (what is chosen, as keys of the command line) -> works (paintings, one at a
time); tab (controls beside an easel, made of elements, of one visit) -> server (for this machine alone)
"""
