"""``task=studio``: serve a page on this machine for painting photographs; needs the ``studio`` extra.

- `photos` stores the user's files, `wishes` converts choices to command-line overrides, and `works` paints one
  painting at a time.
- `tab` builds the page of one `visit`: `controls` next to an `easel`, both made of `elements`.
- `server` serves the page to this machine only.

``task=view`` shows finished pages and does not need the extra: `view` serves them through `serving`, also to this
machine only.
"""
