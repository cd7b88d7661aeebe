"""Compare settings: paired differences, fronts, curves and effects of sweeps, and ``task=compare``.

`plotting` and `contact_sheet` draw for other packages, too.
"""
