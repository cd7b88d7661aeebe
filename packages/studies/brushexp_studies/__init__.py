"""Compare settings: paired differences, fronts, curves and effects of sweeps, and ``task=compare``.

Other packages also use `plotting` and `contact_sheet`.
"""
