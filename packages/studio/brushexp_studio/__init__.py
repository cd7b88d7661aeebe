"""``task=studio``: serve a page on this machine for painting photographs; needs the extra ``studio``.

photos (the user's files) -> wishes (choices as command-line overrides) -> works (paintings, one at a time); tab
(controls next to an easel, made of elements, for one visit) -> server (for this machine only)

``task=view`` shows finished pages and does not need the extra: view -> serving (to this machine only).
"""
